// Levenberg-Marquardt refinement of a homography by its transfer errors in both images.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "geometry/epipolar.h"
#include "geometry/pair_arrays.h"
#include "geometry/sampson_refinement.h"

namespace rilievo {

/// The H (Frobenius norm 1) that minimises the sum of SquaredTransfer of at least four pairs, |y - H x|^2 / v2 +
/// |x - H^-1 y|^2 / v1, from `start`, over its nine entries less their scale (Hartley & Zisserman 4.2.2). The cost
/// never rises. None when `start` is singular or maps a point beyond the horizon.
std::optional<Eigen::Matrix3d> RefineHomography(const PairArrays& pairs, const CoordinateVariances& variances,
                                                const Eigen::Matrix3d& start, const RefinementOptions& options = {});

}  // namespace rilievo
