// A finished (or unfinished) run found again in its workspace.
#pragma once

#include <filesystem>

#include "block/orientation_result.h"
#include "scheduling/orient_keys.h"
#include "scheduling/workspace.h"

namespace rilievo::app {

struct StoredRun {
  scheduling::Workspace workspace;
  scheduling::RunRecord record;
  scheduling::OrientKeys keys;
};

/// Throws Error when DIR is no workspace, or one in which nothing was run.
StoredRun OpenRun(const std::filesystem::path& dir);

/// The orientation of the run; throws Error saying what to do when there is none yet.
OrientationResult RequireOrientation(const StoredRun& run);

}  // namespace rilievo::app
