// The task that orients a block: tracks, mapping, adjustment.
#pragma once

#include <memory>
#include <optional>

#include "block/orientation_result.h"
#include "engine/plan.h"
#include "scheduling/orient_run.h"

namespace rilievo::scheduling {

/// Adds the orientation after `gathered`, before which all features and pairs are done: its cost comes from their
/// counts.
void AddOrientationTask(const std::shared_ptr<OrientRun>& run, TaskId gathered, engine::Plan& plan);

/// The finished orientation, or none when it is not there (or damaged: then it is quarantined).
std::optional<OrientationResult> LoadOrientation(const engine::ArtifactStore& store, const OrientKeys& keys);

}  // namespace rilievo::scheduling
