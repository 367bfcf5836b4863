// Levenberg-Marquardt refinement of a fundamental matrix by its Sampson distances.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "geometry/epipolar.h"
#include "geometry/pair_arrays.h"
#include "geometry/sampson_refinement.h"

namespace rilievo {

/// The F (Frobenius norm 1, rank 2) that minimises the sum of squared Sampson distances of at least seven pairs of
/// points of magnitude about 1, from `start`, over its seven degrees of freedom: F = U diag(1, s, 0) V', two rotation
/// vectors and s (Bartoli & Sturm, PAMI 26(3), 2004). The cost never rises. None when `start` or the result is not
/// finite.
std::optional<Eigen::Matrix3d> RefineFundamental(const PairArrays& pairs, const CoordinateVariances& variances,
                                                 const Eigen::Matrix3d& start, const RefinementOptions& options = {});

}  // namespace rilievo
