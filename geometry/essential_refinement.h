// Levenberg-Marquardt refinement of an essential matrix by its Sampson distances.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "geometry/epipolar.h"
#include "geometry/pair_arrays.h"
#include "geometry/sampson_refinement.h"

namespace rilievo {

/// The E (Frobenius norm 1) that minimises the sum of squared Sampson distances of at least five pairs of ideal
/// coordinates, from `start`, over its five degrees of freedom: a rotation vector and two steps on the sphere of
/// translations. The cost never rises. None when `start` or the result is not finite. About 5 ns a pair and iteration
/// (AVX-512).
std::optional<Eigen::Matrix3d> RefineEssential(const PairArrays& pairs, const CoordinateVariances& variances,
                                               const Eigen::Matrix3d& start, const RefinementOptions& options = {});

}  // namespace rilievo
