// Draws keypoints over their image, for people to look at.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "block/features.h"
#include "block/pixels.h"

namespace rilievo::images {

/// Larger images are drawn reduced by the least whole number that brings them below this.
inline constexpr std::uint64_t kMaxDrawnPixels = 25'000'000;

/// Radius of the circle around a feature, in multiples of its scale.
inline constexpr double kDrawnRadius = 3;

/// The bytes of a PNG in colour: the image as stored (16 bits shown as their leading 8), around each keypoint a circle
/// of kDrawnRadius times its scale (1.5 px at least) with a tick in its direction; the colour tells the octave of the
/// scale. Throws Error(kUnsupported) for a shape that PNG cannot hold (a side above a million pixels).
std::vector<unsigned char> DrawKeypoints(const GreyImage& image, std::span<const Keypoint> keypoints,
                                         std::uint64_t max_pixels = kMaxDrawnPixels);

/// Upper bound of what DrawKeypoints holds beside its input.
std::uint64_t DrawKeypointsBytes(int width_px, int height_px);

}  // namespace rilievo::images
