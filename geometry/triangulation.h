// Forward intersection: an object point from its rays, with and without wrong rays.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "geometry/rigid3.h"

namespace rilievo {

/// A camera as loops over many rays want it: x_cam = rotation * x_world + translation.
struct CameraPose {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  ///< projection centre, world frame

  CameraPose() = default;
  explicit CameraPose(const Rigid3& cam_from_world)
      : rotation(cam_from_world.RotationMatrix()),
        translation(cam_from_world.translation),
        center(cam_from_world.Center()) {}
};

/// One measured ray. Residuals are |projection - normalized| * focal_px: pixels of the ideal (undistorted) image.
struct RayView {
  const CameraPose* pose = nullptr;
  Eigen::Vector2d normalized = Eigen::Vector2d::Zero();  ///< X/Z, Y/Z
  double focal_px = 1;
};

/// Residual in px; infinite for a point on or behind the camera's plane.
double RayResidualPx(const RayView& view, const Eigen::Vector3d& point);

/// Largest angle between any two rays from the projection centres to the point, rad. O(n^2), above 32 views a bound
/// from below within a few per cent (the angles of 32 views spread over the list).
double IntersectionAngle(std::span<const RayView> views, const Eigen::Vector3d& point);

/// Point nearest to all rays (linear; the start of an iteration). None for fewer than two views or parallel rays.
std::optional<Eigen::Vector3d> IntersectRays(std::span<const RayView> views);

/// Gauss-Newton on the normalised image coordinates, weighted by focal_px; stops when the step is below 1e-10 of the
/// distance. None when the point leaves the front of a camera or the normal equations are singular.
std::optional<Eigen::Vector3d> RefineIntersection(std::span<const RayView> views, const Eigen::Vector3d& start,
                                                  int max_iterations = 5);

struct IntersectionOptions {
  double max_residual_px = 4.0;
  double min_angle_rad = 0.026;
  std::uint64_t seed = 0;  ///< draws the pairs of tracks with more than 10 rays
};

struct Intersection {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  std::vector<std::uint8_t> is_inlier;  ///< per view; at least two
  double angle_rad = 0;
};

/// Robust forward intersection: all rays first; when one does not fit, the pair of rays (all pairs up to 10 rays, 45
/// drawn pairs above) with the least truncated cost gives the start, and its inliers are adjusted. None when no two
/// rays agree within the residual under an angle of min_angle_rad in front of their cameras.
std::optional<Intersection> IntersectRobustly(std::span<const RayView> views, const IntersectionOptions& options);

}  // namespace rilievo
