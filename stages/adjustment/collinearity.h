// The collinearity equations of one image point, linearised.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "geometry/camera_model.h"

namespace rilievo::adjustment {

/// Least distance from the camera's plane at which a point projects, in the model's unit.
inline constexpr double kLeastDepth = 1e-12;
/// Both components of the residual of a point on or behind the camera's plane, which has no derivatives: such a step
/// is refused by its cost instead of ending the adjustment.
inline constexpr double kBehind_px = 1e4;

/// A ray's residual and how it depends on the point in the camera frame, x = R X + t.
struct Collinearity {
  Eigen::Vector2d residual_px;                  ///< projected - measured
  Eigen::Vector3d rotated;                      ///< R X
  Eigen::Matrix<double, 2, 3> by_camera_point;  ///< d residual / d x; zero behind the camera
};

inline Collinearity Linearize(const CameraModel& camera, const Eigen::Matrix3d& rotation,
                              const Eigen::Vector3d& translation, const Eigen::Vector3d& point,
                              const Eigen::Vector2d& measured_px) {
  Collinearity c;
  c.rotated = rotation * point;
  const Eigen::Vector3d x = c.rotated + translation;
  if (!(x.z() > kLeastDepth)) {
    c.residual_px.setConstant(kBehind_px);
    c.by_camera_point.setZero();
    return c;
  }
  const double inverse_z = 1 / x.z();
  const Eigen::Vector2d ideal = x.head<2>() * inverse_z;
  Eigen::Vector2d image = ideal;
  c.by_camera_point << inverse_z, 0, -ideal.x() * inverse_z, 0, inverse_z, -ideal.y() * inverse_z;
  if (camera.HasDistortion()) {
    const CameraModel::Distorted distorted = camera.DistortWithJacobian(ideal);
    image = distorted.value;
    c.by_camera_point = (distorted.jacobian * c.by_camera_point).eval();
  }
  c.residual_px = Eigen::Vector2d(camera.fx * image.x() + camera.cx, camera.fy * image.y() + camera.cy) - measured_px;
  c.by_camera_point.row(0) *= camera.fx;
  c.by_camera_point.row(1) *= camera.fy;
  return c;
}

/// The residual alone.
inline Eigen::Vector2d ResidualPx(const CameraModel& camera, const Eigen::Matrix3d& rotation,
                                  const Eigen::Vector3d& translation, const Eigen::Vector3d& point,
                                  const Eigen::Vector2d& measured_px) {
  const Eigen::Vector3d x = rotation * point + translation;
  if (!(x.z() > kLeastDepth)) return Eigen::Vector2d::Constant(kBehind_px);
  const Eigen::Vector2d ideal = x.head<2>() / x.z();
  const Eigen::Vector2d image = camera.HasDistortion() ? camera.Distort(ideal) : ideal;
  return Eigen::Vector2d(camera.fx * image.x() + camera.cx, camera.fy * image.y() + camera.cy) - measured_px;
}

/// d residual / d (rotation vector w, translation), with R' = exp(w) R: d x / d w = -[R X]x, so a row g of
/// by_camera_point gives (R X) x g.
inline Eigen::Matrix<double, 2, 6> ByPose(const Collinearity& c) {
  Eigen::Matrix<double, 2, 6> j;
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector3d g = c.by_camera_point.row(i);
    j.block<1, 3>(i, 0) = c.rotated.cross(g).transpose();
    j.block<1, 3>(i, 3) = g.transpose();
  }
  return j;
}

/// exp(w) as a quaternion.
Eigen::Quaterniond RotationExp(const Eigen::Vector3d& w);

}  // namespace rilievo::adjustment
