// Essential matrices of five corresponding rays.
#pragma once

#include <Eigen/Core>
#include <array>
#include <span>

#include "geometry/solvers/model_list.h"

namespace rilievo {

using EssentialList = ModelList<Eigen::Matrix3d, 10>;

/// All real E (Frobenius norm 1) with second[i]' E first[i] = 0 of five pairs of rays (any scale; e.g. (x, y, 1)) and
/// the constraints det E = 0, 2 E E' E = tr(E E') E. Planar scenes are no special case; five rays that a pure rotation
/// maps leave the solution undetermined (what comes out then means nothing). About 6 us. Nistér, "An efficient solution
/// to the five-point relative pose problem", PAMI 26(6), 2004.
EssentialList SolveFivePoint(const std::array<Eigen::Vector3d, 5>& first, const std::array<Eigen::Vector3d, 5>& second);

}  // namespace rilievo
