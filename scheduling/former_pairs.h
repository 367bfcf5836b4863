// Pairs that an earlier run of the workspace has compared, whatever tiles they lie in now.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <vector>

#include "block/pair.h"
#include "engine/artifact_store.h"
#include "engine/plan.h"
#include "scheduling/orient_keys.h"
#include "scheduling/workspace.h"

namespace rilievo::scheduling {

/// A tile's key covers all of its pairs: an image added or removed makes new tiles of old pairs. A pair has a key of
/// its own here (its two images' features and cameras, and how it is compared); its result is copied from the old tile.
class FormerPairs {
 public:
  /// Of the tiles of `record` that are in `store`. Time and memory O(pairs); reads no tile.
  FormerPairs(const RunRecord& record, const engine::ArtifactStore& store);

  /// For every pair of `tile` its result, or none. Holds one old tile at a time.
  std::vector<std::optional<TwoViewGeometry>> Find(const PairTile& tile, const Block& block,
                                                   const OrientOptions& options, const OrientKeys& keys,
                                                   const engine::ArtifactStore& store,
                                                   engine::TaskContext& context) const;

 private:
  struct Place {
    std::size_t tile = 0, pair = 0;
  };
  std::vector<engine::ArtifactKey> tiles_;
  std::vector<std::size_t> sizes_;  ///< pairs a tile
  std::map<Sha256Digest, Place> places_;
};

}  // namespace rilievo::scheduling
