// One detected and described feature, and what a detector is given beside the pixels.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "block/features.h"
#include "block/pixels.h"

namespace rilievo::features {

struct Feature {
  Keypoint keypoint;
  Descriptor descriptor{};
};

/// How an image is cut while it is worked on: never part of a result. Strips of this width run down the image (or an
/// octave of it), up to `chunks` of them at once.
struct Tiling {
  int strip_width_px = 512;
  int chunks = 8;
};

/// An image to detect in. Pixels where the mask is below 128 are not used; an empty mask uses all.
struct Input {
  const GreyImage& image;
  std::span<const std::uint8_t> mask = {};
  Tiling tiling = {};
};

/// Index of the pixel that holds a position; one outside the image counts for the border.
inline std::size_t PixelUnder(const GreyImage& image, double x_px, double y_px) {
  const int column = std::clamp(static_cast<int>(x_px), 0, image.width_px - 1);
  const int row = std::clamp(static_cast<int>(y_px), 0, image.height_px - 1);
  return static_cast<std::size_t>(row) * static_cast<std::size_t>(image.width_px) + static_cast<std::size_t>(column);
}

/// Whether the mask lets a position be used.
inline bool IsUsed(const Input& input, double x_px, double y_px) {
  return input.mask.empty() || input.mask[PixelUnder(input.image, x_px, y_px)] >= 128;
}

}  // namespace rilievo::features
