// Features of one image that lie at one position count as one.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "block/features.h"

namespace rilievo::tracks {

/// Largest distance of two features taken for one (SPEC 2.1 item 3). SIFT gives a position with two directions twice.
inline constexpr double kSamePosition_px = 0.1;

/// For each feature the one that stands for its position: itself, or the first (in the order x, y, index) of those that
/// stand for themselves and are no farther than kSamePosition_px. The one that stands for others is never represented
/// itself, so no position drifts along a chain. O(n log n) while positions are spread.
std::vector<std::uint32_t> RepresentativeFeatures(std::span<const Keypoint> keypoints);

}  // namespace rilievo::tracks
