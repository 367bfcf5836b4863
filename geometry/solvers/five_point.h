// Essential matrices of five corresponding rays.
#pragma once

#include <Eigen/Core>
#include <array>

#include "geometry/kernels/two_view_kernels.h"
#include "geometry/solvers/model_list.h"

namespace rilievo {

using EssentialList = ModelList<Eigen::Matrix3d, 10>;

/// All real E (Frobenius norm 1) with (y, 1)' E (x, 1) = 0 of five pairs of ideal coordinates x = first[i], y =
/// second[i] and the constraints det E = 0, 2 E E' E = tr(E E') E. Planar scenes are no special case; five rays that a
/// pure rotation maps leave the solution undetermined (what comes out then means nothing). Nistér, "An efficient
/// solution to the five-point relative pose problem", PAMI 26(6), 2004. Works on a batch of which all but one sample
/// are idle: who has many samples calls the kernels themselves (TwoViewKernels::five_point), at an eighth of the cost.
EssentialList SolveFivePoint(const std::array<Eigen::Vector2d, 5>& first, const std::array<Eigen::Vector2d, 5>& second,
                             const TwoViewKernels& kernels = ActiveTwoViewKernels());

}  // namespace rilievo
