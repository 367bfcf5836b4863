// Pairs and tiles: every pair once, in a fixed order, for any block size and tile edge.
#include "scheduling/pair_selection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <utility>
#include <vector>

#include "stages/tracks/triplets.h"

namespace rilievo::scheduling {
namespace {

TEST(SelectPairs, CountsAreThoseOfTheMethod) {
  for (std::size_t n = 0; n < 40; ++n) {
    EXPECT_EQ(SelectPairs(n, Network::kSparse).size(), n * (n - (n > 0)) / 2);
    EXPECT_EQ(SelectPairs(n, Network::kSequence).size(), n < 2 ? 0 : n == 2 ? 1 : 2 * n - 3);
  }
}

TEST(SelectPairs, EveryTripletOfASequenceHasItsThreePairs) {
  const auto pairs = SelectPairs(12, Network::kSequence);
  for (std::uint32_t i = 0; i + 2 < 12; ++i)
    for (const auto& [a, b] : {std::pair{i, i + 1}, std::pair{i + 1, i + 2}, std::pair{i, i + 2}})
      EXPECT_TRUE(std::binary_search(pairs.begin(), pairs.end(), ImagePair{ImageId(a), ImageId(b)}));
}

TEST(SelectPairs, AClosedSequenceAddsThePairsOfItsEnd) {
  for (std::size_t n = 0; n < 40; ++n) {
    const auto open = SelectPairs(n, Network::kSequence), closed = SelectPairs(n, Network::kSequence, true);
    std::set<ImagePair> expected(open.begin(), open.end());
    for (const auto& t : tracks::SequenceTriplets(n, true))
      for (const auto& [a, b] : {std::pair{t[0], t[1]}, std::pair{t[1], t[2]}, std::pair{t[0], t[2]}})
        expected.insert({std::min(a, b), std::max(a, b)});
    EXPECT_EQ(closed, std::vector<ImagePair>(expected.begin(), expected.end())) << n;
    EXPECT_TRUE(n < 5 || closed.size() == 2 * n) << n;
    EXPECT_EQ(SelectPairs(n, Network::kSparse, true), SelectPairs(n, Network::kSparse));
  }
}

TEST(TilePairs, VisitsEachPairOnceWithItsImages) {
  for (const Network network : {Network::kSparse, Network::kSequence}) {
    for (std::size_t n : {2, 3, 7, 16, 41}) {
      for (std::size_t edge : {1, 2, 3, 4, 8}) {
        const auto pairs = SelectPairs(n, network);
        std::multiset<ImagePair> seen;
        std::pair<std::size_t, std::size_t> last(0, 0);
        for (const PairTile& tile : TilePairs(pairs, edge)) {
          EXPECT_LE(tile.images.size(), 2 * edge);
          EXPECT_TRUE(std::is_sorted(tile.images.begin(), tile.images.end()));
          EXPECT_LE(last, std::pair(tile.column, tile.row)) << "a tile must not come before one that can start earlier";
          last = {tile.column, tile.row};
          for (const ImagePair& pair : tile.pairs) {
            seen.insert(pair);
            EXPECT_EQ(pair.first.value / edge, tile.row);
            EXPECT_EQ(pair.second.value / edge, tile.column);
            for (const ImageId id : {pair.first, pair.second})
              EXPECT_TRUE(std::binary_search(tile.images.begin(), tile.images.end(), id));
          }
        }
        EXPECT_EQ(std::multiset<ImagePair>(pairs.begin(), pairs.end()), seen);
      }
    }
  }
}

/// Loads of an image's features when a block of columns stays while its tiles run in order, and when every tile loads
/// all of its own.
TEST(TilePairs, ABlockOfColumnsStaysWhileItsTilesRun) {
  constexpr std::size_t kImages = 160, kEdge = 8, kBlocks = kImages / kEdge;
  ASSERT_EQ(TileEdge(kImages), kEdge);
  std::size_t resident_loads = 0, plain_loads = 0, resident = kBlocks;
  std::vector<std::size_t> times_resident(kBlocks, 0);
  for (const PairTile& tile : TilePairs(SelectPairs(kImages, Network::kSparse), kEdge)) {
    plain_loads += tile.images.size();
    if (resident != tile.column) resident_loads += kEdge, ++times_resident[resident = tile.column];
    if (tile.row != tile.column) resident_loads += kEdge;
  }
  EXPECT_EQ(std::count(times_resident.begin(), times_resident.end(), 1), static_cast<std::ptrdiff_t>(kBlocks));
  EXPECT_EQ(resident_loads, kEdge * (kBlocks + kBlocks * (kBlocks - 1) / 2)) << "once a block and once a tile";
  EXPECT_LT(resident_loads, plain_loads * 6 / 10);
}

}  // namespace
}  // namespace rilievo::scheduling
