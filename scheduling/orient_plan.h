// Expands a block and options into an engine plan: features -> pairs (matching, verification) -> orientation.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "block/block.h"
#include "block/orientation_result.h"
#include "block/pixels.h"
#include "engine/artifact_store.h"
#include "engine/plan.h"
#include "scheduling/orient_keys.h"
#include "scheduling/orient_options.h"

namespace rilievo::scheduling {

/// Everything the tasks of a run share; must outlive the execution of the plan. Tasks write only to their own slots.
struct OrientRun {
  const Block& block;
  const PixelSource& pixels;
  const engine::ArtifactStore& store;
  OrientOptions options;
  OrientKeys keys;
  std::vector<ImageSummary> images;            ///< slot an image: filled by its feature task
  std::vector<std::vector<PairSummary>> pairs; ///< slot a tile: filled by its pair task
  std::string pixel_memory_hint;               ///< hint when an image cannot fit the memory

  OrientRun(const Block& block, const PixelSource& pixels, const engine::ArtifactStore& store, OrientOptions options);
};

/// The plan: one task an image, one a tile of the pair matrix, ordered so that a tile comes right after its last image;
/// the orientation task is added when all counts are known, with a cost from those counts.
engine::Plan MakeOrientPlan(std::shared_ptr<OrientRun> run);

/// The finished orientation, or none when it is not there (or damaged: then it is quarantined).
std::optional<OrientationResult> LoadOrientation(const engine::ArtifactStore& store, const OrientKeys& keys);

/// What a run would do, without running it.
struct PlanSummary {
  std::size_t images = 0, pairs = 0, feature_tasks = 0, pair_tasks = 0, orientation_tasks = 1;
  std::size_t feature_tasks_done = 0, pair_tasks_done = 0;
  bool orientation_done = false;
  std::uint64_t peak_bytes = 0;           ///< largest task
  std::string peak_task;
  std::uint64_t disk_bytes = 0;           ///< still to be written: an estimate from feature caps and usual match rates
  double work_s = 0;                      ///< CPU seconds still to be spent
  double time_s = 0;                      ///< wall time on `threads` within `memory_bytes`
};

PlanSummary Summarize(const OrientRun& run, std::uint64_t memory_bytes, int threads);

}  // namespace rilievo::scheduling
