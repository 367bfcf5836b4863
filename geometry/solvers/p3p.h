// Space resection of a calibrated camera from three points (P3P).
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "geometry/rigid3.h"

namespace rilievo {

/// All real poses (0 to 4) that see three object points along three rays. `rays_in_cam`: unit vectors, camera frame;
/// `points_in_world`: the points, any unit. Every returned cam_from_world has the points in front of the camera along
/// their rays, to about 1e-12 of the distance. Empty for collinear points, coincident points or coincident rays.
///
/// The distances l satisfy three conics l_i^2 + l_j^2 - 2 b_ij l_i l_j = a_ij. Their pencil's degenerate member is
/// split into two lines that are intersected with a conic (idea of Persson & Nordberg, "Lambda Twist", ECCV 2018; the
/// split is Richter-Gebert's, "Perspectives on Projective Geometry", 11.1), and the distances are polished by Newton's
/// iteration. About 2 us.
std::vector<Rigid3> SolveP3p(const std::array<Eigen::Vector3d, 3>& rays_in_cam,
                             const std::array<Eigen::Vector3d, 3>& points_in_world);

}  // namespace rilievo
