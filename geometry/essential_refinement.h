// Levenberg-Marquardt refinement of an essential matrix by its Sampson distances.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "geometry/epipolar.h"

namespace rilievo {

struct EssentialRefinementOptions {
  int max_iterations = 20;
  double relative_decrease = 1e-10;  ///< stop once the cost falls by less
};

/// The E (Frobenius norm 1) that minimises the sum of squared Sampson distances of at least five pairs of ideal
/// coordinates, from `start`, over its five degrees of freedom: a rotation vector and two steps on the sphere of
/// translations. The cost never rises. None when `start` or the result is not finite. About 0.1 us a pair and
/// iteration.
std::optional<Eigen::Matrix3d> RefineEssential(std::span<const Eigen::Vector2d> first,
                                               std::span<const Eigen::Vector2d> second,
                                               const CoordinateVariances& variances, const Eigen::Matrix3d& start,
                                               const EssentialRefinementOptions& options = {});

}  // namespace rilievo
