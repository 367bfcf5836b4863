// Chooses the tracks that stay.
#include "stages/tracks/reduction.h"

#include <algorithm>
#include <cstdint>
#include <utility>

namespace rilievo::tracks {
namespace {

std::vector<std::uint8_t> BestOfCells(const TieIndex& index) {
  std::vector<std::uint8_t> is_kept(index.Count(), 0), is_filled(index.CellCount(), 0);
  for (std::size_t rank = 0; rank < index.Count(); ++rank) {
    const auto cells = index.Cells(rank);
    is_kept[rank] = std::any_of(cells.begin(), cells.end(), [&](std::uint32_t cell) { return is_filled[cell] == 0; });
    for (const std::uint32_t cell : cells) is_filled[cell] = 1;
  }
  return is_kept;
}

/// Pairs that must keep common tie points, sorted: the strong ones, and the strongest of each image.
std::vector<ImagePair> GuaranteedPairs(const TieInput& input) {
  std::vector<ImagePair> pairs;
  std::vector<std::vector<std::pair<std::size_t, ImagePair>>> of_image(input.block.images.size());
  for (const TwoViewGeometry& g : input.pairs) {
    if (!g.IsVerified()) continue;
    if (g.inliers.size() >= kStrongPair) pairs.push_back(g.pair);
    for (const ImageId image : {g.pair.first, g.pair.second})
      of_image[image.value].emplace_back(g.inliers.size(), g.pair);
  }
  for (auto& ranked : of_image) {
    std::sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) {
      return a.first != b.first ? a.first > b.first : a.second < b.second;
    });
    for (std::size_t k = 0; k < std::min(ranked.size(), kLinksPerImage); ++k) pairs.push_back(ranked[k].second);
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  return pairs;
}

/// Ranks ascend from the best track, so what is added first is the best.
void AddLackingTracks(const TieIndex& index, const ImagePair& pair, std::vector<std::uint8_t>& is_kept) {
  const auto common = index.Common(pair);
  auto kept = static_cast<std::size_t>(
      std::count_if(common.begin(), common.end(), [&](std::uint32_t rank) { return is_kept[rank] != 0; }));
  for (std::size_t k = 0; k < common.size() && kept < kCommonPoints; ++k)
    if (!is_kept[common[k]]) is_kept[common[k]] = 1, ++kept;
}

}  // namespace

Reduction ReduceTracks(const TieInput& input, double cell_px) {
  const TieIndex index(input, cell_px);
  std::vector<std::uint8_t> is_kept = BestOfCells(index);
  for (const ImagePair& pair : GuaranteedPairs(input)) AddLackingTracks(index, pair, is_kept);
  Reduction result{{}, index.Measure(std::vector<std::uint8_t>(index.Count(), 1)), index.Measure(is_kept)};
  for (std::size_t rank = 0; rank < index.Count(); ++rank)
    if (is_kept[rank]) result.tracks.push_back(index.track(rank));
  std::sort(result.tracks.begin(), result.tracks.end(),
            [](const Track& a, const Track& b) { return a.elements < b.elements; });
  return result;
}

}  // namespace rilievo::tracks
