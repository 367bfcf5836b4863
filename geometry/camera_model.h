// Pinhole cameras with rational-radial and tangential distortion, OpenCV's forward form (COLMAP's PINHOLE to
// FULL_OPENCV).
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string_view>

namespace rilievo {

/// Named subsets of the parameters; each is COLMAP's model of that name and exports as such.
enum class CameraModelKind { kSimplePinhole, kPinhole, kSimpleRadial, kRadial, kOpenCv, kFullOpenCv };

/// Pixel frame: x right, y down, the upper-left pixel's CENTRE is (0.5, 0.5). With x = X/Z, y = Y/Z, r2 = x^2 + y^2:
///   d = (1 + k1 r2 + k2 r2^2 + k3 r2^3) / (1 + k4 r2 + k5 r2^2 + k6 r2^3)
///   x' = x d + 2 p1 x y + p2 (r2 + 2 x^2),  y' = y d + p1 (r2 + 2 y^2) + 2 p2 x y
///   u = fx x' + cx,  v = fy y' + cy.        Parameters a kind does not have are zero; fx = fy for the SIMPLE_/RADIAL
///   kinds.
struct CameraModel {
  CameraModelKind kind = CameraModelKind::kPinhole;
  double fx = 0, fy = 0, cx = 0, cy = 0;
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0;

  bool HasDistortion() const {
    return k1 != 0 || k2 != 0 || p1 != 0 || p2 != 0 || k3 != 0 || k4 != 0 || k5 != 0 || k6 != 0;
  }
  double MeanFocal() const { return 0.5 * (fx + fy); }
  struct Distorted {
    Eigen::Vector2d value;
    Eigen::Matrix2d jacobian;  ///< d value / d ideal
  };
  /// Ideal image coordinates (X/Z, Y/Z) to distorted ones.
  Eigen::Vector2d Distort(const Eigen::Vector2d& ideal) const;
  /// The same with its derivative, for adjustments.
  Distorted DistortWithJacobian(const Eigen::Vector2d& ideal) const;
  /// Pixel of a point in the camera frame; none when it lies on or behind the camera's plane (Z <= 0).
  std::optional<Eigen::Vector2d> Project(const Eigen::Vector3d& x_in_cam) const;
  /// Ideal coordinates (X/Z, Y/Z) of a pixel: Newton's iteration on Distort, to 1e-12; none where the distortion cannot
  /// be inverted (far outside the calibrated field).
  std::optional<Eigen::Vector2d> Normalize(const Eigen::Vector2d& pixel_px) const;
};

/// "PINHOLE", "OPENCV", ... and back (none for other names).
std::string_view CameraModelName(CameraModelKind kind);
std::optional<CameraModelKind> CameraModelKindFromName(std::string_view name);

}  // namespace rilievo
