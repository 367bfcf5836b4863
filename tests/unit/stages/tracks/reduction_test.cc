// Tie point reduction: cells, guarantees and order against brute force.
#include "stages/tracks/reduction.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <tuple>

#include "tests/support/synthetic_block.h"

namespace rilievo::tracks {
namespace {

using test::MakeSyntheticBlock;
using test::SyntheticBlock;

using Elements = std::vector<std::vector<FeatureRef>>;
using Cell = std::tuple<ImageId, int, int>;

SyntheticBlock DenseBlock(int points) {
  SyntheticBlock b = MakeSyntheticBlock({.images = 8, .points = points, .noise_px = 0.3, .wrong_share = 0.1});
  Rng rng(5);
  for (auto& image : b.keypoints)
    for (Keypoint& k : image) k.scale_px = static_cast<float>(rng.Uniform(1, 9));
  return b;
}

Reduction Reduce(const SyntheticBlock& b, double cell_px = 0) {
  return ReduceTracks({b.block, b.keypoints, b.pairs, b.tracks}, cell_px);
}

Elements ElementsOf(const std::vector<Track>& tracks) {
  Elements result;
  for (const Track& t : tracks) result.push_back(t.elements);
  return result;
}

std::vector<Cell> CellsOf(const SyntheticBlock& b, const Track& track, double cell_px) {
  std::vector<Cell> cells;
  for (const FeatureRef& e : track.elements) {
    const Image& image = b.block.image(e.image);
    const double width = cell_px > 0 ? cell_px : 200 * std::sqrt(image.width_px * image.height_px / 12e6);
    const Eigen::Vector2d at = b.keypoints[e.image.value][e.feature].Position();
    cells.emplace_back(e.image, static_cast<int>(at.x() / width), static_cast<int>(at.y() / (0.75 * width)));
  }
  return cells;
}

/// Most rays of a track, by cell.
std::map<Cell, std::size_t> MostRays(const SyntheticBlock& b, const std::vector<Track>& tracks, double cell_px) {
  std::map<Cell, std::size_t> most;
  for (const Track& t : tracks)
    for (const Cell& cell : CellsOf(b, t, cell_px)) most[cell] = std::max(most[cell], t.elements.size());
  return most;
}

std::size_t Common(const std::vector<Track>& tracks, const ImagePair& pair) {
  return static_cast<std::size_t>(std::count_if(tracks.begin(), tracks.end(), [&](const Track& t) {
    const auto has = [&](ImageId i) {
      return std::any_of(t.elements.begin(), t.elements.end(), [&](const FeatureRef& e) { return e.image == i; });
    };
    return has(pair.first) && has(pair.second);
  }));
}

TEST(Reduction, EveryCellKeepsItsBestTrackWhole) {
  for (const double cell_px : {0.0, 130.0}) {
    const SyntheticBlock b = DenseBlock(9000);
    const Reduction r = Reduce(b, cell_px);
    const auto before = MostRays(b, b.tracks, cell_px), after = MostRays(b, r.tracks, cell_px);
    EXPECT_EQ(before, after) << "cells, and the most rays in each";
    const Elements all = ElementsOf(b.tracks);
    const std::set<std::vector<FeatureRef>> known(all.begin(), all.end());
    for (const Track& t : r.tracks) {
      EXPECT_TRUE(known.contains(t.elements)) << "a kept track lost a ray";
      const auto cells = CellsOf(b, t, cell_px);
      EXPECT_TRUE(std::any_of(cells.begin(), cells.end(), [&](const Cell& c) {
        return before.at(c) == t.elements.size();
      })) << "kept without being the best of a cell";
    }
    EXPECT_LE(r.tracks.size() * 5, b.tracks.size());
    EXPECT_EQ(r.before.cells, before.size());
    EXPECT_EQ(r.after.cells, after.size());
    EXPECT_EQ(r.before.points, b.tracks.size());
    EXPECT_EQ(r.after.points, r.tracks.size());
  }
}

TEST(Reduction, OfEqualMultiplicityTheSmallerScaleStays) {
  SyntheticBlock b = MakeSyntheticBlock({.images = 3, .points = 1});
  ASSERT_EQ(b.tracks.size(), 1U);
  b.pairs.clear();
  Track finer;
  for (const FeatureRef& e : b.tracks[0].elements) {
    auto& keypoints = b.keypoints[e.image.value];
    finer.elements.push_back({e.image, static_cast<std::uint32_t>(keypoints.size())});
    keypoints.push_back(keypoints[e.feature]);
    keypoints.back().scale_px *= 0.5F;
  }
  b.tracks.push_back(finer);
  const Reduction r = Reduce(b);
  ASSERT_EQ(r.tracks.size(), 1U);
  EXPECT_EQ(r.tracks[0].elements, finer.elements);
}

TEST(Reduction, StrongPairsAndLinksKeepTheirShare) {
  const SyntheticBlock b = DenseBlock(400);
  const Reduction r = Reduce(b, 50000);  // one cell an image: the cells alone would leave a handful of tracks
  std::map<ImageId, std::pair<std::size_t, std::size_t>> links;  // before, after
  std::size_t strong = 0, least = 1000000;
  for (const auto& g : b.pairs) {
    if (!g.IsVerified()) continue;
    const std::size_t before = Common(b.tracks, g.pair), after = Common(r.tracks, g.pair);
    if (g.inliers.size() >= 30) {
      ++strong;
      least = std::min(least, after);
      EXPECT_GE(after, std::min<std::size_t>(10, before));
    }
    for (const ImageId i : {g.pair.first, g.pair.second}) {
      links[i].first += before >= 10;
      links[i].second += after >= 10;
    }
  }
  ASSERT_GT(strong, 10U);
  EXPECT_EQ(r.after.least_common, least);
  std::size_t least_links = 1000000;
  for (const auto& [image, counts] : links) {
    EXPECT_GE(counts.second, std::min<std::size_t>(5, counts.first));
    least_links = std::min(least_links, counts.second);
  }
  EXPECT_EQ(r.after.least_links, least_links);
  EXPECT_EQ(r.after.groups, 1U);
  EXPECT_LT(r.tracks.size(), b.tracks.size() / 4);
}

TEST(Reduction, WeakPairsOfAThinBlockStayLinked) {
  // Pairs of fewer than 30 matches guarantee nothing by themselves, but each image keeps its strongest five.
  SyntheticBlock b = DenseBlock(400);
  for (auto& g : b.pairs) g.inliers.resize(std::min<std::size_t>(g.inliers.size(), 12));
  const Reduction r = Reduce(b, 50000);
  EXPECT_EQ(r.after.least_common, 0U);  // no strong pair
  EXPECT_GE(r.after.least_links, 5U);
}

TEST(Reduction, ForgetsTheOrderOfItsInput) {
  SyntheticBlock b = DenseBlock(3000);
  const Elements expected = ElementsOf(Reduce(b).tracks);
  EXPECT_TRUE(std::is_sorted(expected.begin(), expected.end()));
  Rng rng(3);
  for (std::size_t i = b.tracks.size(); i > 1; --i)
    std::swap(b.tracks[i - 1], b.tracks[rng.Below(static_cast<std::uint32_t>(i))]);
  std::reverse(b.pairs.begin(), b.pairs.end());
  EXPECT_EQ(ElementsOf(Reduce(b).tracks), expected);
}

TEST(Reduction, OfNothingIsNothing) {
  SyntheticBlock b = DenseBlock(100);
  b.tracks.clear();
  const Reduction r = Reduce(b);
  EXPECT_TRUE(r.tracks.empty());
  EXPECT_EQ(r.before.cells, 0U);
  EXPECT_EQ(r.after.groups, 0U);
}

TEST(TieIndex, GroupsAreThoseThatTiePointsHoldTogether) {
  const SyntheticBlock b = MakeSyntheticBlock({.images = 4, .points = 300, .scenes = 3});
  const Reduction r = Reduce(b);
  EXPECT_EQ(r.before.groups, 3U);
  EXPECT_EQ(r.after.groups, 3U);
  EXPECT_EQ(r.before.linked_pairs, 18U);
}

}  // namespace
}  // namespace rilievo::tracks
