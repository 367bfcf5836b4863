// Seven-parameter similarities and their least-squares estimation from points.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <span>

#include "geometry/rigid3.h"

namespace rilievo {

/// x_b = scale * rotation * x_a + translation.
struct Similarity3 {
  double scale = 1.0;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& x_in_a) const { return scale * (rotation * x_in_a) + translation; }
  Similarity3 Inverse() const {
    const Eigen::Quaterniond inverse = rotation.conjugate();
    return {1.0 / scale, inverse, -(inverse * translation) / scale};
  }
};

/// cam_from_b for a camera known as cam_from_a; the camera's own scale changes with it.
Rigid3 TransformPose(const Similarity3& b_from_a, const Rigid3& cam_from_a);

/// Least-squares similarity with x_b[i] ~ b_from_a * x_a[i] (Umeyama 1991). Needs >= 3 points that are not collinear
/// for a unique rotation; none when fewer than 3 points or all points coincide. O(n).
std::optional<Similarity3> FitSimilarity(std::span<const Eigen::Vector3d> x_in_a,
                                         std::span<const Eigen::Vector3d> x_in_b);

}  // namespace rilievo
