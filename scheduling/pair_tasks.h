// The tasks that match and verify pairs, tile by tile.
#pragma once

#include <span>
#include <vector>

#include "block/pair.h"
#include "engine/plan.h"
#include "scheduling/orient_run.h"

namespace rilievo::scheduling {

/// Adds the tasks of the tiles of one column (sorted by row): the features of the column's images are loaded once and
/// stay, charged to the budget, until the last of its tiles is done; each tile loads those of its rows. Their feature
/// tasks must be in the plan; the tiles join run->tile_tasks.
void AddColumn(const std::shared_ptr<OrientRun>& run, std::vector<std::shared_ptr<TileRun>> column, engine::Plan& plan);

/// Adds `pairs` (sorted), which are in no tile of the run yet, as tiles of their own.
void AddTiles(const std::shared_ptr<OrientRun>& run, const std::vector<ImagePair>& pairs, engine::Plan& plan);

/// The pairs of a tile's artifact, with the numbers of the block: an artifact does not know them. Throws
/// Error(kInvalidInput) when it is not the tile's.
std::vector<TwoViewGeometry> LoadTile(const PairTile& tile, std::span<const std::byte> payload);

}  // namespace rilievo::scheduling
