// The tasks of a guided block: sketches, the visibility map, and the growth of its pairs.
#pragma once

#include <functional>
#include <memory>

#include "engine/plan.h"
#include "scheduling/orient_run.h"

namespace rilievo::scheduling {

/// Adds the tasks of a guided block up to its pairs: features and a sketch an image, the visibility map a tile (right
/// after its last image); the strong pairs of a map tile are added, and compared, as soon as it is done; then every
/// image's best partners; then, round by round, the pairs that verified ones make likely, until there is none. When all
/// pairs are done, `finish` grows the plan; its argument is the task that everything before is done with.
void AddGuidedTasks(const std::shared_ptr<OrientRun>& run, engine::Plan& plan,
                    std::function<void(TaskId, engine::Plan&)> finish);

/// Adds to `keys` the tiles of a guided block that the results in `store` tell of: those that a run would come upon
/// without computing anything but them.
void FindGuidedTiles(const Block& block, const OrientOptions& options, const engine::ArtifactStore& store,
                     OrientKeys& keys);

/// Everything else that a guided block has on disk: sketches, the visibility map, and the rounds of growth up to the
/// first that is not there. `keys` holds the tiles that FindGuidedTiles found.
std::vector<engine::ArtifactKey> GuidedKeys(const Block& block, const OrientOptions& options,
                                            const engine::ArtifactStore& store, const OrientKeys& keys);

/// Upper bounds of what one sketch task and one task of the map need.
TaskCost SketchTaskCost(const OrientRun& run);
TaskCost VisibilityTaskCost(const OrientRun& run, const PairTile& tile);

/// The tiles of the visibility map: all pairs.
std::vector<PairTile> VisibilityTiles(std::size_t images);

}  // namespace rilievo::scheduling
