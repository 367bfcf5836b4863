// Epipolar geometry of two images: essential matrix and relative pose, distances, intersection angles.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <span>

#include "geometry/rigid3.h"

namespace rilievo {

Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& v);

/// E = [t]x R with x_second' E x_first = 0 for rays (x, y, 1).
Eigen::Matrix3d EssentialFromPose(const Rigid3& second_from_first);

/// The four poses (|translation| = 1) of E or of the essential matrix nearest to it. Hartley & Zisserman 9.6.2.
std::array<Rigid3, 4> DecomposeEssential(const Eigen::Matrix3d& essential);

/// Both depths positive where the rays (x, y, 1) come nearest; `angle_rad` between them, 0 for parallel rays.
struct RayIntersection {
  bool in_front = false;
  double angle_rad = 0;
};
RayIntersection IntersectRays(const Rigid3& second_from_first, const Eigen::Vector2d& first,
                              const Eigen::Vector2d& second);

/// The pose of E that has most points in front of both cameras; ties go to the one that DecomposeEssential lists first.
struct PoseSelection {
  Rigid3 second_from_first;
  std::size_t in_front = 0;
};
PoseSelection SelectPose(const Eigen::Matrix3d& essential, std::span<const Eigen::Vector2d> first,
                         std::span<const Eigen::Vector2d> second);

/// Variances of a coordinate in the unit of the points; (1, 1) for pixels. Ideal coordinates measured with a standard
/// deviation of 1 px have 1 / focal_px^2: then distances come out in pixels, also for two different cameras.
struct CoordinateVariances {
  double first = 1, second = 1;
};

/// Squared Sampson distance of a pair to E (ideal coordinates) or F (pixels), in units of the standard deviation:
/// (y'Mx)^2 / (v1 |(M'y)_12|^2 + v2 |(Mx)_12|^2). Sampson 1982; Hartley & Zisserman 11.4.3.
double SquaredSampson(const Eigen::Matrix3d& m, const Eigen::Vector2d& first, const Eigen::Vector2d& second,
                      const CoordinateVariances& variances = {});

/// d^2(second, M first) + d^2(first, M' second): both distances to the epipolar lines, squared and added.
double SquaredEpipolarDistances(const Eigen::Matrix3d& m, const Eigen::Vector2d& first, const Eigen::Vector2d& second,
                                const CoordinateVariances& variances = {});

/// Mean of the squared distances |second - H first|^2 and |first - H^-1 second|^2, each in units of its image's
/// standard deviation; infinity where a point maps to or behind the horizon.
double SquaredTransfer(const Eigen::Matrix3d& h, const Eigen::Matrix3d& h_inverse, const Eigen::Vector2d& first,
                       const Eigen::Vector2d& second, const CoordinateVariances& variances = {});

/// Angle between the two rays of a point at the rotation given, were it infinitely far: the parallax that rotation
/// leaves.
double ParallaxAngle(const Eigen::Quaterniond& rotation, const Eigen::Vector2d& first, const Eigen::Vector2d& second);

}  // namespace rilievo
