// What the tasks of an orientation run share.
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "block/block.h"
#include "block/orientation_result.h"
#include "block/pixels.h"
#include "engine/artifact_store.h"
#include "scheduling/orient_keys.h"
#include "scheduling/orient_options.h"

namespace rilievo::scheduling {

/// Everything the tasks of a run share; must outlive the execution of the plan. Tasks write only to their own slots.
struct OrientRun {
  const Block& block;
  const PixelSource& pixels;
  const PixelSource* masks;  ///< of the images that have one; may be null when none has
  const engine::ArtifactStore& store;
  OrientOptions options;
  OrientKeys keys;
  std::vector<ImageSummary> images;             ///< slot an image: filled by its feature task
  std::vector<std::vector<PairSummary>> pairs;  ///< slot a tile: filled by its pair task
  /// What the process holds beside its tasks: hints about memory add it to what a task needs.
  std::uint64_t overhead_bytes = 0;
  /// What one task may hold: images are cut into strips so that their features fit it.
  std::uint64_t budget_bytes = std::numeric_limits<std::uint64_t>::max();

  OrientRun(const Block& block, const PixelSource& pixels, const PixelSource* masks, const engine::ArtifactStore& store,
            OrientOptions options, std::uint64_t overhead_bytes);
  /// The run that was planned, now with the store that it writes to; nothing is computed again.
  OrientRun(const OrientRun& planned, const engine::ArtifactStore& store);
};

}  // namespace rilievo::scheduling
