// Errors of an orientation against the exact truth of the simulated scene it was made from.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "app/command.h"
#include "block/orientation_result.h"
#include "scheduling/workspace.h"

namespace rilievo::app {

/// Of the largest component. Throws Error when the scene cannot be read, or is seen not to be the one that the run's
/// images show: other names or sizes, another scene file than the one beside the images or the one that was oriented.
/// Warns when the poses have nothing in common with the truth.
nlohmann::json TruthJson(const std::string& scene_path, const scheduling::RunRecord& run,
                         const OrientationResult& result, const ProgramContext& context);
std::string TruthText(const std::string& scene_path, const scheduling::RunRecord& run, const OrientationResult& result,
                      const ProgramContext& context);

}  // namespace rilievo::app
