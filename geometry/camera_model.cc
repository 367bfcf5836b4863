// Projection, distortion and its inversion.
#include "geometry/camera_model.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <utility>

namespace rilievo {
namespace {

constexpr std::array<std::pair<CameraModelKind, std::string_view>, 6> kNames{
    {{CameraModelKind::kSimplePinhole, "SIMPLE_PINHOLE"},
     {CameraModelKind::kPinhole, "PINHOLE"},
     {CameraModelKind::kSimpleRadial, "SIMPLE_RADIAL"},
     {CameraModelKind::kRadial, "RADIAL"},
     {CameraModelKind::kOpenCv, "OPENCV"},
     {CameraModelKind::kFullOpenCv, "FULL_OPENCV"}}};

}  // namespace

CameraModel::Distorted CameraModel::DistortWithJacobian(const Eigen::Vector2d& ideal) const {
  const double x = ideal.x(), y = ideal.y(), r2 = x * x + y * y;
  const double num = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), den = 1 + r2 * (k4 + r2 * (k5 + r2 * k6));
  const double num_r2 = k1 + r2 * (2 * k2 + r2 * 3 * k3), den_r2 = k4 + r2 * (2 * k5 + r2 * 3 * k6);
  const double d = num / den, d_r2 = (num_r2 - d * den_r2) / den;
  Distorted out;
  out.value = {x * d + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * d + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
  out.jacobian << d + 2 * x * x * d_r2 + 2 * p1 * y + 6 * p2 * x, 2 * x * y * d_r2 + 2 * p1 * x + 2 * p2 * y,
      2 * x * y * d_r2 + 2 * p1 * x + 2 * p2 * y, d + 2 * y * y * d_r2 + 6 * p1 * y + 2 * p2 * x;
  return out;
}

Eigen::Vector2d CameraModel::Distort(const Eigen::Vector2d& ideal) const {
  return HasDistortion() ? DistortWithJacobian(ideal).value : ideal;
}

std::optional<Eigen::Vector2d> CameraModel::Project(const Eigen::Vector3d& x_in_cam) const {
  if (!(x_in_cam.z() > 0)) return std::nullopt;
  const Eigen::Vector2d d = Distort(x_in_cam.hnormalized());
  return Eigen::Vector2d(fx * d.x() + cx, fy * d.y() + cy);
}

std::optional<Eigen::Vector2d> CameraModel::Normalize(const Eigen::Vector2d& pixel_px) const {
  const Eigen::Vector2d target((pixel_px.x() - cx) / fx, (pixel_px.y() - cy) / fy);
  if (!HasDistortion()) return target;
  Eigen::Vector2d p = target;
  for (int i = 0; i < 30; ++i) {
    const Distorted at = DistortWithJacobian(p);
    const double det = at.jacobian.determinant();
    if (!(det > 1e-6)) return std::nullopt;  // past the fold of the radial polynomial
    const Eigen::Vector2d step = at.jacobian.inverse() * (target - at.value);
    p += step;
    if (!p.allFinite()) return std::nullopt;
    if (step.squaredNorm() < 1e-26) return p;
  }
  return (DistortWithJacobian(p).value - target).norm() < 1e-10 ? std::optional(p) : std::nullopt;
}

std::string_view CameraModelName(CameraModelKind kind) {
  for (const auto& [k, name] : kNames)
    if (k == kind) return name;
  return "UNKNOWN";
}

std::optional<CameraModelKind> CameraModelKindFromName(std::string_view name) {
  for (const auto& [kind, n] : kNames)
    if (n == name) return kind;
  return std::nullopt;
}

}  // namespace rilievo
