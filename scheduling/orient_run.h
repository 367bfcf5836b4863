// What the tasks of an orientation run share.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "block/block.h"
#include "block/orientation_result.h"
#include "block/pixels.h"
#include "engine/artifact_store.h"
#include "scheduling/orient_keys.h"
#include "scheduling/orient_options.h"

namespace rilievo::scheduling {

/// Where a run ends.
enum class Goal { kPairs, kOrientation };

class FormerPairs;

/// A tile in a run, and what its task found.
struct TileRun {
  std::size_t number = 0;  ///< in its task's name
  PairTile tile;
  engine::ArtifactKey key;
  std::vector<PairSummary> pairs;
  std::size_t taken_over = 0;  ///< pairs that were there already, in this tile or in one of a former run
  bool reused = false;
};

/// Everything the tasks of a run share; must outlive the execution of the plan. Tasks write only to their own slots;
/// `tiles` and `tile_tasks` grow with the plan, by the executor's scheduler alone, and are complete before any task
/// looks at all of them.
struct OrientRun {
  const Block& block;
  const PixelSource& pixels;
  const PixelSource* masks;  ///< of the images that have one; may be null when none has
  const engine::ArtifactStore& store;
  OrientOptions options;
  OrientKeys keys;
  std::vector<ImageSummary> images;             ///< slot an image: filled by its feature task
  std::vector<std::shared_ptr<TileRun>> tiles;  ///< in any order; those of `keys` first
  std::vector<TaskId> feature_tasks;            ///< by image
  std::vector<TaskId> tile_tasks;               ///< of `tiles`
  /// What the process holds beside its tasks: hints about memory add it to what a task needs.
  std::uint64_t overhead_bytes = 0;
  /// What one task may hold: images are cut into strips so that their features fit it.
  std::uint64_t budget_bytes = std::numeric_limits<std::uint64_t>::max();
  /// Of the strips that features are detected in; 0 = as wide as the budget allows. Never changes a result.
  int strip_width_px = 0;
  Goal goal = Goal::kOrientation;
  /// Pairs that a former run with other images has compared; may be null.
  std::shared_ptr<const FormerPairs> former;
  /// Images that the orientation took over from a checkpoint of an earlier run; filled by its task.
  std::size_t images_taken_over = 0;

  OrientRun(const Block& block, const PixelSource& pixels, const PixelSource* masks, const engine::ArtifactStore& store,
            OrientOptions options, std::uint64_t overhead_bytes);
  /// The run that was planned, now with the store that it writes to; nothing is computed again.
  OrientRun(const OrientRun& planned, const engine::ArtifactStore& store);
};

}  // namespace rilievo::scheduling
