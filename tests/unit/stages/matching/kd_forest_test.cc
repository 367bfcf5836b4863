// Distances and k-d trees against plain loops: the trees' shape, exact searches, limited ones.
#include "stages/matching/kd_forest.h"

#include <gtest/gtest.h>

#include <numeric>
#include <set>

#include "base/error.h"
#include "stages/matching/kd_matching.h"
#include "stages/matching/matching.h"
#include "tests/support/descriptors.h"

namespace rilievo::matching {
namespace {

using test::Descriptors;

TEST(Distances, EveryKernelGivesTheSumOfSquares) {
  Descriptors points = test::AnyBytes(60, 1);
  points[3].fill(255), points[4].fill(0);
  Descriptors queries = test::AnyBytes(5, 2);
  queries[0].fill(0), queries[1].fill(255);
  Rng rng(3);
  for (const Kernel& kernel : AllKernels()) {
    if (!kernel.is_supported) continue;
    for (std::size_t count = 0; count <= 13; ++count) {
      for (const Descriptor& query : queries) {
        std::vector<std::uint32_t> indices(count);
        for (auto& index : indices) index = rng.Below(60);
        if (count > 2) indices[0] = 3, indices[1] = 4;
        std::vector<std::int32_t> found(count + 1, -7);
        DistanceKernelOf(kernel.name)(query.data(), points.front().data(), indices.data(), count, found.data());
        for (std::size_t i = 0; i < count; ++i) {
          ASSERT_EQ(found[i], test::DistanceSq(query, points[indices[i]])) << kernel.name;
        }
        ASSERT_EQ(found[count], -7) << kernel.name << " writes beyond the end";
      }
    }
  }
}

/// Points of the subtree at `node`; fails where a leaf holds what a split on its way excludes.
void CheckSubtree(const KdForest& forest, std::uint32_t node, std::vector<std::array<int, 3>> limits,
                  std::vector<std::uint32_t>& members) {
  const KdForest::Node& here = forest.nodes()[node];
  if (here.IsLeaf()) {
    std::set<Descriptor> distinct;
    ASSERT_LT(here.begin, here.second) << "an empty leaf";
    for (const std::uint32_t index : forest.order().subspan(here.begin, here.second - here.begin)) {
      members.push_back(index);
      distinct.insert(forest.points()[index]);
      for (const auto& [dimension, low, high] : limits) {
        ASSERT_GE(forest.points()[index][static_cast<std::size_t>(dimension)], low);
        ASSERT_LT(forest.points()[index][static_cast<std::size_t>(dimension)], high);
      }
    }
    ASSERT_TRUE(here.second - here.begin <= 8 || distinct.size() == 1);
    return;
  }
  auto second = limits;
  limits.push_back({here.dimension, 0, here.split});
  second.push_back({here.dimension, here.split, 256});
  CheckSubtree(forest, node + 1, limits, members);
  CheckSubtree(forest, here.second, second, members);
}

TEST(KdForestShape, LeavesKeepTheirSplitsAndHoldEveryPointOnce) {
  Descriptors lone_difference(1000, Descriptor{});  // a sample of the points may well be equal where they are not
  lone_difference[501][90] = 1;
  for (const Descriptors& points :
       {test::SiftLike(700, 1), test::Ties(700, 2), test::SiftLike(1, 3), lone_difference}) {
    for (const int trees : {1, 4}) {
      const KdForest forest(points, trees);
      ASSERT_EQ(forest.roots().size(), static_cast<std::size_t>(trees));
      for (const std::uint32_t root : forest.roots()) {
        std::vector<std::uint32_t> members, all(points.size());
        CheckSubtree(forest, root, {}, members);
        std::sort(members.begin(), members.end());
        std::iota(all.begin(), all.end(), 0U);
        EXPECT_EQ(members, all);
      }
    }
  }
}

TEST(KdForestShape, TreesDifferFromEachOtherAndNotFromRunToRun) {
  const Descriptors points = test::SiftLike(300, 4);
  const KdForest forest(points, 4), again(points, 4);
  EXPECT_TRUE(std::equal(forest.order().begin(), forest.order().end(), again.order().begin(), again.order().end()));
  EXPECT_FALSE(std::equal(forest.order().begin(), forest.order().begin() + 300, forest.order().begin() + 300));
}

std::size_t compared = 0;
void Counting(const std::uint8_t* query, const std::uint8_t* points, const std::uint32_t* indices, std::size_t count,
              std::int32_t* out) {
  compared += count;
  DistancesScalar(query, points, indices, count, out);
}

TEST(KdSearch, ComparesAsManyPointsAsAskedAndNeverOneTwice) {
  const Descriptors points = test::SiftLike(2000, 5), queries = test::SiftLike(20, 6);
  const KdForest forest(points, 4);
  KdSearch search(forest, Counting);
  for (const std::size_t checks : {1, 32, 500}) {
    for (const Descriptor& query : queries) {
      compared = 0;
      search.Find(query, checks);
      EXPECT_GE(compared, checks);
      EXPECT_LT(compared, checks + 8);
    }
  }
  compared = 0;
  search.Find(queries[0], 100'000);
  EXPECT_LE(compared, points.size());
}

TEST(KdSearch, MoreChecksNeverFindAFartherNeighbour) {
  const Descriptors points = test::SiftLike(3000, 7), queries = test::SecondView(points, 12, 8);
  const KdForest forest(points, 4);
  KdSearch search(forest, DistancesScalar);
  std::size_t improved = 0;
  for (std::size_t i = 0; i < 200; ++i) {
    BestTwo before;
    for (const std::size_t checks : {4, 16, 64, 256, 1024}) {
      const BestTwo best = search.Find(queries[i], checks);
      ASSERT_LE(best.first_sq, before.first_sq);
      ASSERT_LE(best.second_sq, before.second_sq);
      ASSERT_EQ(best.first_sq, test::DistanceSq(queries[i], points[best.index]));
      improved += before.first_sq != BestTwo::kNone && best.first_sq < before.first_sq;
      before = best;
    }
  }
  EXPECT_GT(improved, 50U);
}

TEST(KdSearch, AnExactSearchNeedNotCompareAll) {
  // Two clusters: the other one is too far to be looked at.
  Descriptors points = test::AnyBytes(1000, 9, 0, 20);
  const Descriptors far = test::AnyBytes(1000, 10, 200, 220);
  points.insert(points.end(), far.begin(), far.end());
  const KdForest forest(points, 1);
  KdSearch search(forest, Counting);
  compared = 0;
  search.Find(points[0], 0);
  EXPECT_LE(compared, 1000U);
}

void ExpectEqual(const std::vector<BestTwo>& found, const std::vector<BestTwo>& expected, std::string_view what) {
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    ASSERT_EQ(found[i].first_sq, expected[i].first_sq) << what << " " << i;
    ASSERT_EQ(found[i].second_sq, expected[i].second_sq) << what << " " << i;
    if (expected[i].first_sq != BestTwo::kNone) {
      ASSERT_EQ(found[i].index, expected[i].index) << what << " " << i;
    }
  }
}

TEST(KdMatching, WithoutLimitTheTableIsThatOfTheSweep) {
  const SerialRunContext context;
  const Descriptors sift = test::SiftLike(400, 11);
  // One byte varies most, so every path splits it several times; the nearest differs in this byte alone, by 70, and its
  // cell is entered only where offsets in the byte replace each other: their sum exceeds all other distances.
  Descriptors wide_b = test::AnyBytes(900, 22, 0, 20), wide_a(wide_b.begin(), wide_b.begin() + 300);
  Rng rng(23);
  for (std::size_t i = 0; i < wide_b.size(); ++i) {
    wide_b[i][0] = static_cast<std::uint8_t>(rng.Below(256));
    if (i < 300) wide_a[i][0] = static_cast<std::uint8_t>(wide_b[i][0] < 128 ? wide_b[i][0] + 70 : wide_b[i][0] - 70);
  }
  const std::vector<std::pair<Descriptors, Descriptors>> pairs = {{sift, test::SecondView(sift, 15, 12)},
                                                                  {test::Ties(301, 13), test::Ties(517, 14)},
                                                                  {test::AnyBytes(90, 15), test::AnyBytes(133, 16)},
                                                                  {sift, {sift[5]}},
                                                                  {wide_a, wide_b},
                                                                  {sift, {}},
                                                                  {{}, sift}};
  for (const auto& [a, b] : pairs) {
    const NeighborTable expected = FindTwoNearest(a, b, ChooseKernel("scalar"), context);
    for (const Kernel& kernel : AllKernels()) {
      if (!kernel.is_supported) continue;
      const NeighborTable found = FindTwoNearestByTrees(a, b, 0, true, kernel, context);
      ExpectEqual(found.of_a, expected.of_a, "rows");
      ExpectEqual(found.of_b, expected.of_b, "columns");
    }
  }
}

TEST(KdMatching, MatchesAreThoseOfM2WithoutLimitAndMostOfThemWithOne) {
  SerialRunContext context;
  const Descriptors a = test::SiftLike(3000, 17), b = test::SecondView(a, 10, 18);
  for (const bool mutual : {true, false}) {
    const auto m2 = matching::Run(a, b, {.mutual = mutual, .matcher = "m2"}, context);
    ASSERT_GT(m2.size(), 1400U);
    EXPECT_EQ(matching::Run(a, b, {.mutual = mutual, .matcher = "kd-tree", .kd_checks = 0}, context), m2);
    const auto some = matching::Run(a, b, {.mutual = mutual, .matcher = "kd-tree", .kd_checks = 256}, context);
    std::vector<Match> both;
    std::set_intersection(some.begin(), some.end(), m2.begin(), m2.end(), std::back_inserter(both));
    EXPECT_GT(static_cast<double>(both.size()), 0.8 * static_cast<double>(m2.size()));
  }
}

TEST(KdMatching, ALimitedSearchGivesTheSameTableFromEveryKernel) {
  const SerialRunContext context;
  const Descriptors a = test::SiftLike(900, 19), b = test::SecondView(a, 20, 20);
  const NeighborTable expected = FindTwoNearestByTrees(a, b, 40, true, ChooseKernel("scalar"), context);
  for (const Kernel& kernel : AllKernels()) {
    if (!kernel.is_supported) continue;
    const NeighborTable found = FindTwoNearestByTrees(a, b, 40, true, kernel, context);
    ExpectEqual(found.of_a, expected.of_a, kernel.name);
    ExpectEqual(found.of_b, expected.of_b, kernel.name);
  }
}

}  // namespace
}  // namespace rilievo::matching
