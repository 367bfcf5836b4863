// Fundamental matrices of seven corresponding points, and of many.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <span>

#include "geometry/solvers/model_list.h"

namespace rilievo {

using FundamentalList = ModelList<Eigen::Matrix3d, 3>;

/// The one to three F (Frobenius norm 1) with second[i]' F first[i] = 0 and det F = 0 of seven pairs of points (x, y,
/// 1), which the caller has normalised (NormalizingTransform). About 2 us. Hartley & Zisserman, Multiple View
/// Geometry, 11.1.2; Barazzetti et al. 2010.
FundamentalList SolveSevenPoint(const std::array<Eigen::Vector3d, 7>& first,
                                const std::array<Eigen::Vector3d, 7>& second);

/// Linear least squares for E or F of at least eight pairs, weighted (empty = all 1); normalised inside. `essential`
/// makes the two singular values equal, else the smallest is set to 0. None when the pairs leave it undetermined. Not
/// for planar scenes. Hartley, "In defense of the eight-point algorithm", PAMI 19(6), 1997.
enum class EpipolarKind { kEssential, kFundamental };
std::optional<Eigen::Matrix3d> SolveEightPoint(std::span<const Eigen::Vector2d> first,
                                               std::span<const Eigen::Vector2d> second, std::span<const double> weights,
                                               EpipolarKind kind);

/// Similarity that moves the points' centroid to the origin and makes their mean distance from it sqrt(2).
Eigen::Matrix3d NormalizingTransform(std::span<const Eigen::Vector2d> points);

}  // namespace rilievo
