// Collinearity equations, analytic derivatives, pose increments.
#include "stages/adjustment/reprojection.h"

#include <Eigen/Geometry>
#include <cmath>

namespace rilievo::adjustment {
namespace {

using PoseJacobian = Eigen::Matrix<double, 2, kPoseSize, Eigen::RowMajor>;
using PointJacobian = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;

Eigen::Quaterniond RotationExp(const Eigen::Vector3d& w) {
  const double angle = w.norm(), half = 0.5 * angle;
  const double s = angle > 1e-8 ? std::sin(half) / angle : 0.5;
  return {std::cos(half), s * w.x(), s * w.y(), s * w.z()};
}

}  // namespace

bool Reprojection::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  const Eigen::Map<const Eigen::Quaterniond> q(parameters[0]);
  const Eigen::Map<const Eigen::Vector3d> t(parameters[0] + 4), point(parameters[1]);
  const Eigen::Matrix3d r = q.toRotationMatrix();
  const Eigen::Vector3d rotated = r * point, x = rotated + t;
  Eigen::Map<Eigen::Vector2d> residual(residuals);
  const bool wants_pose = jacobians != nullptr && jacobians[0] != nullptr;
  const bool wants_point = jacobians != nullptr && jacobians[1] != nullptr;
  if (!(x.z() > 1e-12)) {
    residual.setConstant(kBehind_px);
    if (wants_pose) Eigen::Map<PoseJacobian>(jacobians[0]).setZero();
    if (wants_point) Eigen::Map<PointJacobian>(jacobians[1]).setZero();
    return true;
  }
  const double inverse_z = 1 / x.z();
  const Eigen::Vector2d ideal = x.head<2>() * inverse_z;
  Eigen::Vector2d image = ideal;
  PointJacobian by_camera_point;  // d residual / d x
  by_camera_point << inverse_z, 0, -ideal.x() * inverse_z, 0, inverse_z, -ideal.y() * inverse_z;
  if (camera_->HasDistortion()) {
    const CameraModel::Distorted distorted = camera_->DistortWithJacobian(ideal);
    image = distorted.value;
    by_camera_point = distorted.jacobian * by_camera_point;
  }
  residual =
      Eigen::Vector2d(camera_->fx * image.x() + camera_->cx, camera_->fy * image.y() + camera_->cy) - measured_px_;
  by_camera_point.row(0) *= camera_->fx;
  by_camera_point.row(1) *= camera_->fy;
  if (wants_pose) {
    Eigen::Map<PoseJacobian> j(jacobians[0]);
    for (int i = 0; i < 2; ++i) {  // d x / d w = -[R X]x, so that a row g gives (R X) x g
      const Eigen::Vector3d g = by_camera_point.row(i);
      j.row(i).head<3>() = rotated.cross(g);
      j.row(i).segment<3>(3) = g;
      j(i, 6) = 0;
    }
  }
  if (wants_point) Eigen::Map<PointJacobian>{jacobians[1]} = by_camera_point * r;
  return true;
}

bool PoseManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  double d[kPoseIncrements];
  for (int i = 0; i < kPoseIncrements; ++i) d[i] = i == held_ ? 0.0 : delta[i];
  const Eigen::Map<const Eigen::Quaterniond> q(x);
  Eigen::Map<Eigen::Quaterniond> out(x_plus_delta);
  out = (RotationExp({d[0], d[1], d[2]}) * q).normalized();
  for (int i = 0; i < 3; ++i) x_plus_delta[4 + i] = x[4 + i] + d[3 + i];
  return true;
}

bool PoseManifold::PlusJacobian(const double*, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, kPoseSize, kPoseIncrements, Eigen::RowMajor>> j(jacobian);
  j.setZero();
  for (int i = 0; i < kPoseIncrements; ++i) j(i, i) = i == held_ ? 0 : 1;
  return true;
}

bool PoseManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  const Eigen::Map<const Eigen::Quaterniond> qy(y), qx(x);
  const Eigen::AngleAxisd turn(qy * qx.conjugate());
  const Eigen::Vector3d w = turn.angle() * turn.axis();
  for (int i = 0; i < 3; ++i) y_minus_x[i] = w[i], y_minus_x[3 + i] = y[4 + i] - x[4 + i];
  if (held_ >= 0) y_minus_x[held_] = 0;
  return true;
}

bool PoseManifold::MinusJacobian(const double*, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, kPoseIncrements, kPoseSize, Eigen::RowMajor>> j(jacobian);
  j.setZero();
  for (int i = 0; i < kPoseIncrements; ++i) j(i, i) = i == held_ ? 0 : 1;
  return true;
}

}  // namespace rilievo::adjustment
