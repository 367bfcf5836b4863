// Opens workspaces for the commands that read them.
#include "app/stored_run.h"

#include <filesystem>
#include <utility>

#include "scheduling/guided_plan.h"
#include "scheduling/orient_plan.h"

namespace rilievo::app {

StoredRun OpenRun(const std::filesystem::path& dir) {
  scheduling::Workspace workspace = scheduling::Workspace::Open(dir);
  std::optional<scheduling::RunRecord> record = workspace.ReadRecord();
  if (!record) throw Error(ErrorCode::kNotFound, dir.string(), "holds no run", "run rilievo orient first");
  scheduling::OrientKeys keys = scheduling::ComputeKeys(record->block, record->options, record->processor_level);
  if (!keys.tiles_complete) scheduling::FindGuidedTiles(record->block, record->options, workspace.store(), keys);
  return {std::move(workspace), std::move(*record), std::move(keys)};
}

OrientationResult RequireOrientation(const StoredRun& run) {
  auto result = scheduling::LoadOrientation(run.workspace.store(), run.keys);
  if (!result)
    throw Error(ErrorCode::kNotFound, run.workspace.dir().string(),
                "has no finished orientation for this version of the program",
                "run the same rilievo orient command again; finished work is reused");
  return std::move(*result);
}

}  // namespace rilievo::app
