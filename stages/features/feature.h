// One detected and described feature, and what a detector is given beside the pixels.
#pragma once

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

}  // namespace rilievo::features
