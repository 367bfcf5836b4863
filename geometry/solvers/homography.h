// Homographies of four corresponding points, and of many.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <span>

#include "geometry/rigid3.h"
#include "geometry/solvers/model_list.h"

namespace rilievo {

/// H (Frobenius norm 1) with second[i] ~ H first[i] of four pairs (x, y, 1); none when three points of one image are in
/// line or the pairs contradict a plane seen from one side by both cameras (H's scale factors of different sign). The
/// caller normalises. About 0.1 us. Hartley & Zisserman, 2.4 (projective bases); oriented check: Chum, Werner & Matas,
/// ICPR 2004.
std::optional<Eigen::Matrix3d> SolveHomographyFourPoint(const std::array<Eigen::Vector3d, 4>& first,
                                                        const std::array<Eigen::Vector3d, 4>& second);

/// Linear least squares for H of at least four pairs, normalised inside (DLT, Hartley & Zisserman, algorithm 4.2); none
/// when the pairs leave it undetermined.
std::optional<Eigen::Matrix3d> SolveHomographyLinear(std::span<const Eigen::Vector2d> first,
                                                     std::span<const Eigen::Vector2d> second);

/// The relative poses (|translation| = 1, sign open) that a plane's H in ideal coordinates allows: two in general,
/// which the points alone do not tell apart unless some of them come out behind a camera; none when H is a rotation or
/// not finite. Ma, Soatto, Kosecka & Sastry, An Invitation to 3-D Vision, 5.3.3.
ModelList<Rigid3, 2> DecomposeHomography(const Eigen::Matrix3d& h);

}  // namespace rilievo
