// The index by pair, and copying from old tiles.
#include "scheduling/former_pairs.h"

#include <utility>

#include "block/io/serialize_block.h"
#include "scheduling/counted_io.h"
#include "scheduling/guided_plan.h"

namespace rilievo::scheduling {
namespace {

/// What decides about the result of one pair: the key of a tile that holds it alone.
Sha256Digest PairDigest(const ImagePair& pair, const Block& block, const OrientOptions& options,
                        const OrientKeys& keys) {
  PairTile alone;
  alone.pairs = {pair};
  return TileKey(alone, block, options, keys).digest;
}

}  // namespace

FormerPairs::FormerPairs(const RunRecord& record, const engine::ArtifactStore& store) {
  OrientKeys keys = ComputeKeys(record.block, record.options, record.processor_level);
  if (!keys.tiles_complete) FindGuidedTiles(record.block, record.options, store, keys);
  for (std::size_t t = 0; t < keys.tiles.size(); ++t) {
    if (!store.Exists(keys.pairs[t])) continue;
    const std::vector<ImagePair>& pairs = keys.tiles[t].pairs;
    for (std::size_t i = 0; i < pairs.size(); ++i)
      places_.try_emplace(PairDigest(pairs[i], record.block, record.options, keys), Place{tiles_.size(), i});
    tiles_.push_back(keys.pairs[t]);
    sizes_.push_back(pairs.size());
  }
}

std::vector<std::optional<TwoViewGeometry>> FormerPairs::Find(const PairTile& tile, const Block& block,
                                                              const OrientOptions& options, const OrientKeys& keys,
                                                              const engine::ArtifactStore& store,
                                                              engine::TaskContext& context) const {
  std::vector<std::optional<TwoViewGeometry>> found(tile.pairs.size());
  std::map<std::size_t, std::vector<std::pair<std::size_t, std::size_t>>> wanted;  // old tile: (pair in it, pair here)
  for (std::size_t i = 0; i < tile.pairs.size(); ++i)
    if (const auto place = places_.find(PairDigest(tile.pairs[i], block, options, keys)); place != places_.end())
      wanted[place->second.tile].emplace_back(place->second.pair, i);
  for (const auto& [old, pairs] : wanted) {
    const auto payload = ReadCounted(store, tiles_[old], context);
    if (!payload) continue;  // gone or damaged: they are compared again
    std::vector<TwoViewGeometry> geometries = io::DeserializePairs(*payload);
    if (geometries.size() != sizes_[old]) continue;
    for (const auto& [from, to] : pairs) found[to] = std::move(geometries[from]);
  }
  return found;
}

}  // namespace rilievo::scheduling
