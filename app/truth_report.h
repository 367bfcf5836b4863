// Errors of an orientation against the exact truth of the simulated scene it was made from.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "block/block.h"
#include "block/orientation_result.h"

namespace rilievo::app {

/// Of the largest component. Throws Error when the scene cannot be read or shows other images.
nlohmann::json TruthJson(const std::string& scene_path, const Block& block, const OrientationResult& result);
std::string TruthText(const std::string& scene_path, const Block& block, const OrientationResult& result);

}  // namespace rilievo::app
