// Pairs of images that were taken near each other, from the GNSS positions in EXIF.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "block/block.h"
#include "block/pair.h"

namespace rilievo::scheduling {

/// Where an image was taken, metres in an earth-centred frame (WGS84); none without a position in EXIF. Altitudes count
/// only where every position has one: cameras that do not know it write none or zero.
std::vector<std::optional<Eigen::Vector3d>> ImagePositions(const Block& block);

struct SpatialRule {
  int neighbours = 0;         ///< pairs of an image with its nearest so many, all of equal distance included; 0 = all
  double max_distance_m = 0;  ///< no pair farther apart; 0 = no limit
};

/// Pairs (first < second), sorted: those in which at least one is among the nearest of the other. An image without a
/// position goes with every other. A sweep along the longest axis of the positions: about n log n + n k for images
/// along a path, n^2 at worst.
std::vector<ImagePair> SpatialPairs(std::span<const std::optional<Eigen::Vector3d>> positions, const SpatialRule& rule);

}  // namespace rilievo::scheduling
