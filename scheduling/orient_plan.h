// Expands a block and options into an engine plan: features -> pairs (matching, verification) -> orientation.
#pragma once

#include <memory>
#include <optional>

#include "block/orientation_result.h"
#include "engine/plan.h"
#include "scheduling/orient_run.h"

namespace rilievo::scheduling {

/// The plan: one task an image, one a tile of the pair matrix, ordered so that a tile comes right after its last image;
/// the orientation task is added when all counts are known, with a cost from those counts.
engine::Plan MakeOrientPlan(std::shared_ptr<OrientRun> run);

/// The finished orientation, or none when it is not there (or damaged: then it is quarantined).
std::optional<OrientationResult> LoadOrientation(const engine::ArtifactStore& store, const OrientKeys& keys);

}  // namespace rilievo::scheduling
