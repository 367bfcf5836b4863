// All pairs, sequence pairs, and tiles of the pair matrix.
#include "scheduling/pair_selection.h"

#include <algorithm>
#include <map>
#include <utility>

namespace rilievo::scheduling {

std::vector<ImagePair> SelectPairs(std::size_t image_count, Network network, bool closed_sequence) {
  std::vector<ImagePair> pairs;
  if (network != Network::kSparse && network != Network::kSequence) return pairs;
  for (std::uint32_t i = 0; i < image_count; ++i) {
    const std::size_t end = network == Network::kSequence ? std::min<std::size_t>(i + 3, image_count) : image_count;
    for (std::uint32_t j = i + 1; j < end; ++j) pairs.push_back({ImageId(i), ImageId(j)});
  }
  if (network == Network::kSequence && closed_sequence && image_count >= 4) {
    const auto last = static_cast<std::uint32_t>(image_count - 1);
    for (const auto& [first, second] : {std::pair{0U, last - 1}, std::pair{0U, last}, std::pair{1U, last}})
      pairs.push_back({ImageId(first), ImageId(second)});
    std::sort(pairs.begin(), pairs.end());
    pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  }
  return pairs;
}

std::size_t TileEdge(std::size_t image_count) { return image_count <= 16 ? 2 : image_count <= 150 ? 4 : 8; }

std::vector<PairTile> TilePairs(const std::vector<ImagePair>& pairs, std::size_t tile_edge) {
  std::map<std::pair<std::size_t, std::size_t>, PairTile> by_place;  // (column, row)
  for (const ImagePair& pair : pairs) {
    const std::size_t row = pair.first.value / tile_edge, column = pair.second.value / tile_edge;
    PairTile& tile = by_place[{column, row}];
    tile.row = row;
    tile.column = column;
    tile.pairs.push_back(pair);
    tile.images.push_back(pair.first);
    tile.images.push_back(pair.second);
  }
  std::vector<PairTile> tiles;
  tiles.reserve(by_place.size());
  for (auto& [place, tile] : by_place) {
    std::sort(tile.images.begin(), tile.images.end());
    tile.images.erase(std::unique(tile.images.begin(), tile.images.end()), tile.images.end());
    std::sort(tile.pairs.begin(), tile.pairs.end());
    tiles.push_back(std::move(tile));
  }
  return tiles;
}

}  // namespace rilievo::scheduling
