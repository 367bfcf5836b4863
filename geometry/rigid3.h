// Rigid motions of space: b_from_a maps points given in frame a to frame b.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace rilievo {

/// x_b = rotation * x_a + translation. `rotation` is a unit quaternion.
struct Rigid3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Rigid3() = default;
  Rigid3(const Eigen::Quaterniond& r, const Eigen::Vector3d& t) : rotation(r.normalized()), translation(t) {}
  Rigid3(const Eigen::Matrix3d& r, const Eigen::Vector3d& t)
      : rotation(Eigen::Quaterniond(r).normalized()), translation(t) {}

  Eigen::Vector3d operator*(const Eigen::Vector3d& x_in_a) const { return rotation * x_in_a + translation; }
  Eigen::Matrix3d RotationMatrix() const { return rotation.toRotationMatrix(); }
  Rigid3 Inverse() const {
    const Eigen::Quaterniond inverse = rotation.conjugate();
    return {inverse, -(inverse * translation)};
  }
  /// Origin of frame b seen in frame a; for cam_from_world: the projection centre in the world.
  Eigen::Vector3d Center() const { return -(rotation.conjugate() * translation); }
};

/// c_from_a = c_from_b * b_from_a.
inline Rigid3 operator*(const Rigid3& c_from_b, const Rigid3& b_from_a) {
  return {c_from_b.rotation * b_from_a.rotation, c_from_b.rotation * b_from_a.translation + c_from_b.translation};
}

}  // namespace rilievo
