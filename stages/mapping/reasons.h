// Why an image could not be oriented, in one line with what to do.
#pragma once

#include <span>
#include <vector>

#include "block/model.h"
#include "stages/mapping/mapping.h"

namespace rilievo::mapping {

/// One entry for every image of the block that is in none of the models, by image id.
std::vector<UnorientedImage> UnorientedImages(const Input& input, std::span<const TwoViewGeometry> pairs,
                                              std::span<const Model> models);

}  // namespace rilievo::mapping
