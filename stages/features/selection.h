// Which of an image's features are kept, and in which order.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "stages/features/feature.h"

namespace rilievo::features {

/// Sorts by (y, x, scale, angle), drops repetitions (equal in all of these) and keeps `max_features`: the strongest
/// (ties by that order), or when `spread` those that rank first in their cell of a square grid over the image, cells
/// of about 16 features each, the stronger first within a rank. The order of `features` does not matter.
std::vector<Feature> SelectFeatures(std::vector<Feature> features, std::size_t max_features, bool spread, int width_px,
                                    int height_px);

}  // namespace rilievo::features
