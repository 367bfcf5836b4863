// Corresponding regions of two images of a plane: overlap of ellipses (Mikolajczyk et al., IJCV 65, 2005, section 4).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "block/features.h"

namespace rilievo::bench {

/// How regions are compared. A region is a circle of `radius_sigmas` times the keypoint's scale.
struct OverlapRule {
  double radius_sigmas = 3;
  /// Radius to which the region of the first image is brought, and the other one with it, about their own centres: the
  /// distance of the centres stays what it is, so that larger regions do not do better (section 4.1 there); 0 = leave
  /// regions as they are.
  double normal_radius_px = 30;
  double largest_error = 0.4;  ///< 1 - intersection / union
  /// Circles stay circles: mapped by the mean scale of the local affine form. Foreshortening of about 2 and more makes
  /// ellipses that no circle overlaps enough, so the protocol finds nothing at all between steep views.
  bool is_similar = false;
};

/// 1 - intersection / union of the circle of `radius` about the origin and the ellipse (x - c)' shape^-1 (x - c) <= 1.
/// Integrated over lines: error below 1e-3.
double OverlapError(double radius, const Eigen::Vector2d& center, const Eigen::Matrix2d& shape);

struct ImageSize {
  int width_px = 0, height_px = 0;
};

/// Two images' keypoints (our pixel frame) and the homography from the first to the second in the frame whose origin is
/// the first pixel's centre.
struct PlanarPair {
  std::span<const Keypoint> first, second;
  ImageSize first_size, second_size;
  Eigen::Matrix3d second_from_first;
};

/// A pair of regions whose overlap error is small enough.
struct RegionPair {
  std::uint32_t first = 0, second = 0;
  double error = 1;
};

struct CommonPart {
  std::vector<bool> first, second;  ///< is the keypoint, carried over, inside the other image?
  std::size_t first_count = 0, second_count = 0;
  std::size_t Smaller() const { return first_count < second_count ? first_count : second_count; }
};
CommonPart FindCommonPart(const PlanarPair& pair);

/// All pairs in the common part with an error of at most the rule's, by error, then indices. Regions are compared in
/// the first image; those of the second are mapped by the homography's local affine form.
std::vector<RegionPair> OverlappingRegions(const PlanarPair& pair, const CommonPart& common, const OverlapRule& rule);

/// One-to-one correspondences, least error first.
std::vector<RegionPair> OneToOne(std::span<const RegionPair> by_error, std::size_t first_count,
                                 std::size_t second_count);

}  // namespace rilievo::bench
