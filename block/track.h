// Tie points: the features of several images that show one object point.
#pragma once

#include <compare>
#include <cstdint>
#include <vector>

#include "base/ids.h"

namespace rilievo {

/// One feature of one image.
struct FeatureRef {
  ImageId image;
  std::uint32_t feature = 0;
  friend auto operator<=>(const FeatureRef&, const FeatureRef&) = default;
};

/// At most one feature an image; sorted by image.
struct Track {
  std::vector<FeatureRef> elements;
};

}  // namespace rilievo
