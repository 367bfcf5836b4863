// Neighbours by position against brute force; geodetic positions against a sphere and known distances.
#include "scheduling/spatial_pairs.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "base/rng.h"

namespace rilievo::scheduling {
namespace {

using Positions = std::vector<std::optional<Eigen::Vector3d>>;

/// i and j are a pair when j is not farther from i than i's k-th nearest, or the other way round, and within the limit.
std::vector<ImagePair> BruteForce(const Positions& at, const SpatialRule& rule) {
  const auto distance = [&](std::size_t i, std::size_t j) { return (*at[i] - *at[j]).norm(); };
  const auto is_near = [&](std::size_t i, std::size_t j) {
    if (rule.neighbours == 0) return true;
    int nearer = 0;
    for (std::size_t k = 0; k < at.size(); ++k) nearer += at[k] && k != i && distance(i, k) < distance(i, j) ? 1 : 0;
    return nearer < rule.neighbours;
  };
  std::vector<ImagePair> pairs;
  for (std::uint32_t i = 0; i < at.size(); ++i) {
    for (std::uint32_t j = i + 1; j < at.size(); ++j) {
      const bool known = at[i] && at[j];
      const bool within = known && (rule.max_distance_m == 0 || distance(i, j) <= rule.max_distance_m);
      if (!known || (within && (is_near(i, j) || is_near(j, i)))) pairs.push_back({ImageId(i), ImageId(j)});
    }
  }
  return pairs;
}

Positions Draw(std::size_t count, double missing_share, bool on_grid, std::uint64_t seed) {
  Rng rng(seed);
  Positions positions;
  for (std::size_t i = 0; i < count; ++i) {
    Eigen::Vector3d at(rng.Uniform(0, 40), rng.Uniform(0, 200), rng.Uniform(0, 10));
    if (on_grid) at = (at / 10).array().round();  // many equal distances, many images in one place
    positions.push_back(rng.Uniform() < missing_share ? std::nullopt : std::optional(at));
  }
  return positions;
}

TEST(SpatialPairs, AreThoseOfBruteForce) {
  for (const std::size_t count : {0, 1, 2, 30, 120}) {
    for (const double missing : {0.0, 0.1}) {
      for (const bool on_grid : {false, true}) {
        const Positions positions = Draw(count, missing, on_grid, 7 + count);
        for (const SpatialRule rule :
             {SpatialRule{3, 0}, SpatialRule{0, 2.5}, SpatialRule{6, 25}, SpatialRule{0, 0}, SpatialRule{1000, 0}})
          EXPECT_EQ(SpatialPairs(positions, rule), BruteForce(positions, rule))
              << count << " images, " << rule.neighbours << " neighbours, " << rule.max_distance_m << " m";
      }
    }
  }
}

Block BlockAt(std::initializer_list<std::array<double, 3>> places) {
  Block block;
  for (const auto& place : places) {
    Image image;
    image.exif.gnss = place;
    block.images.push_back(image);
  }
  return block;
}

double Distance(const Block& block) {
  const auto at = ImagePositions(block);
  return (*at.at(0) - *at.at(1)).norm();
}

TEST(ImagePositions, AreMetresOnTheEllipsoid) {
  // A degree of latitude is 110.574 km at the equator, 111.694 km at the poles; of longitude 111.320 km at the equator
  // (NIMA TR8350.2, length of a degree).
  EXPECT_NEAR(Distance(BlockAt({{-0.5, 9, 0}, {0.5, 9, 0}})), 110574, 2);
  EXPECT_NEAR(Distance(BlockAt({{89, 9, 0}, {90, 9, 0}})), 111694, 2);
  EXPECT_NEAR(Distance(BlockAt({{0, 179.5, 0}, {0, -179.5, 0}})), 111320, 4) << "across the date line";
  EXPECT_NEAR(Distance(BlockAt({{45, 9, 100}, {45, 9, 130}})), 30, 1e-6);
}

TEST(ImagePositions, AnUnknownAltitudeTakesAllOutOfTheComparison) {
  EXPECT_NEAR(Distance(BlockAt({{45, 9, 100}, {45, 9, 0}})), 0, 1e-6);
  Block block = BlockAt({{45, 9, 100}, {45, 9, 130}});
  block.images.emplace_back();  // without a position: says nothing about altitudes
  EXPECT_NEAR(Distance(block), 30, 1e-6);
  EXPECT_FALSE(ImagePositions(block)[2]);
}

}  // namespace
}  // namespace rilievo::scheduling
