// Content keys of every artifact of an orientation run: known before anything runs, from inputs and options alone.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "block/block.h"
#include "engine/artifact_store.h"
#include "scheduling/orient_options.h"
#include "scheduling/pair_selection.h"

namespace rilievo::scheduling {

struct OrientKeys {
  std::string processor_level;
  std::vector<engine::ArtifactKey> features;  ///< by image
  std::vector<PairTile> tiles;                ///< of a guided block: those that are known (scheduling/guided_plan.h)
  std::vector<engine::ArtifactKey> pairs;     ///< by tile
  bool tiles_complete = true;                 ///< a guided block's are when its growth has ended
  engine::ArtifactKey orientation;
};

/// Keys depend on the content of the images and masks, the cameras, the options and the stage versions; those of pairs
/// and the orientation also on the processor level (libm chooses its kernels by it); not on names, folders, memory,
/// threads or time. Which pairs a guided block matches follows from all that: its orientation's key is known before its
/// tiles.
OrientKeys ComputeKeys(const Block& block, const OrientOptions& options, std::string_view processor_level);

/// The key of one tile; of `keys` the processor level and the features count.
engine::ArtifactKey TileKey(const PairTile& tile, const Block& block, const OrientOptions& options,
                            const OrientKeys& keys);

/// Adds tiles, with their keys.
void AddTileKeys(std::vector<PairTile> tiles, const Block& block, const OrientOptions& options, OrientKeys& keys);

/// Adds how pairs are matched and verified, versions included, to a key.
void AddMatchingTo(KeyHasher& hasher, const OrientOptions& options, const OrientKeys& keys);

}  // namespace rilievo::scheduling
