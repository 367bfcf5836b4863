// Content keys of every artifact of an orientation run: known before anything runs, from inputs and options alone.
#pragma once

#include <string_view>
#include <vector>

#include "block/block.h"
#include "engine/artifact_store.h"
#include "scheduling/orient_options.h"
#include "scheduling/pair_selection.h"

namespace rilievo::scheduling {

struct OrientKeys {
  std::vector<engine::ArtifactKey> features;  ///< by image
  std::vector<PairTile> tiles;
  std::vector<engine::ArtifactKey> pairs;  ///< by tile
  engine::ArtifactKey orientation;
};

/// Keys depend on the content of the images and masks, the cameras, the options and the stage versions; those of pairs
/// and the orientation also on the processor level (libm chooses its kernels by it); not on names, folders, memory, threads
/// or time.
OrientKeys ComputeKeys(const Block& block, const OrientOptions& options, std::string_view processor_level);

}  // namespace rilievo::scheduling
