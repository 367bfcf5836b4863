// Cells against plain loops over the same cells, and against m2.
#include "stages/matching/cells.h"

#include <gtest/gtest.h>

#include <string>

#include "base/error.h"
#include "stages/matching/cell_centers.h"
#include "stages/matching/matching.h"
#include "tests/support/descriptors.h"

namespace rilievo::matching {
namespace {

using test::Descriptors;

/// The contract by brute force: a row meets all of b in its nearest cells, a column all rows that come by.
NeighborTable Oracle(const Descriptors& a, const Descriptors& b, std::size_t visits) {
  const SerialRunContext context;
  const auto centers = CellCenters(a, b, CellCount(b.size()), ChooseKernel("scalar"), context);
  const auto cells_of = [&](const Descriptor& descriptor, std::size_t count) {
    std::vector<std::pair<std::int32_t, std::size_t>> cells;
    for (std::size_t c = 0; c < centers.size(); ++c) cells.emplace_back(test::DistanceSq(descriptor, centers[c]), c);
    std::sort(cells.begin(), cells.end());
    cells.resize(count);
    return cells;
  };
  std::vector<std::vector<std::uint32_t>> members(centers.size()), guests(b.size());
  for (std::uint32_t j = 0; j < b.size(); ++j) members[cells_of(b[j], 1)[0].second].push_back(j);
  NeighborTable table;
  for (std::uint32_t i = 0; i < a.size(); ++i) {
    std::vector<std::uint32_t> candidates;
    for (const auto& [distance, cell] : cells_of(a[i], visits))
      candidates.insert(candidates.end(), members[cell].begin(), members[cell].end());
    for (const std::uint32_t j : candidates) guests[j].push_back(i);
    table.of_a.push_back(test::NearestOf(a[i], b, candidates));
  }
  for (std::uint32_t j = 0; j < b.size(); ++j) table.of_b.push_back(test::NearestOf(b[j], a, guests[j]));
  return table;
}

void ExpectEqual(const std::vector<BestTwo>& found, const std::vector<BestTwo>& expected, const std::string& what) {
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    ASSERT_EQ(found[i].first_sq, expected[i].first_sq) << what << " " << i;
    ASSERT_EQ(found[i].second_sq, expected[i].second_sq) << what << " " << i;
    if (expected[i].first_sq != BestTwo::kNone) {
      ASSERT_EQ(found[i].index, expected[i].index) << what << " " << i;
    }
  }
}

void ExpectOracle(const Descriptors& a, const Descriptors& b, std::size_t visits) {
  const SerialRunContext context;
  ASSERT_GT(CellCount(b.size()), visits);
  const NeighborTable expected = Oracle(a, b, visits);
  for (const Kernel& kernel : AllKernels()) {
    if (!kernel.is_supported) continue;
    const NeighborTable found = FindTwoNearestInCells(a, b, visits, kernel, context);
    ExpectEqual(found.of_a, expected.of_a, std::string(kernel.name) + " rows");
    ExpectEqual(found.of_b, expected.of_b, std::string(kernel.name) + " columns");
  }
}

TEST(Cells, RowsMeetTheirNearestCellsAndColumnsTheRowsThatComeBy) {
  const Descriptors a = test::SiftLike(700, 1), b = test::SecondView(test::SiftLike(2100, 2), 15, 3);
  for (const std::size_t visits : {1, 2, 3}) ExpectOracle(a, b, visits);
}

TEST(Cells, TiesGoToTheLowerIndexAcrossCellsAndSweeps) {
  ExpectOracle(test::Ties(500, 4), test::Ties(2300, 5), 2);
  // More rows for one cell than are swept at once.
  const Descriptors few = test::SiftLike(7, 6);
  Descriptors many(8200, few[0]), columns = test::SecondView(test::SiftLike(1030, 7), 5, 8);
  for (std::size_t i = 0; i < many.size(); i += 3) many[i] = few[i % 7];
  columns[17] = few[0], columns[900] = few[0];
  ExpectOracle(many, columns, 1);
}

TEST(Cells, EmptyImagesAndFewFeaturesAreM2) {
  const SerialRunContext context;
  const Kernel& kernel = ChooseKernel("");
  const Descriptors none, a = test::SiftLike(300, 9), b = test::SecondView(a, 10, 10);
  EXPECT_EQ(CellCount(0), 1U);
  EXPECT_EQ(CellCount(1023), 1U);
  EXPECT_EQ(CellCount(100'000'000), 512U);
  EXPECT_TRUE(FindTwoNearestInCells(none, none, 1, kernel, context).of_a.empty());
  EXPECT_EQ(FindTwoNearestInCells(none, test::SiftLike(2000, 11), 1, kernel, context).of_b.size(), 2000U);
  const NeighborTable expected = FindTwoNearest(a, b, kernel, context);
  ExpectEqual(FindTwoNearestInCells(a, b, 1, kernel, context).of_a, expected.of_a, "few");
}

TEST(CellCentersTest, MeansAreNearerToTheDescriptorsThanAnyOfThemChosenBlindly) {
  const SerialRunContext context;
  const Descriptors a = test::SiftLike(600, 12), b = test::SiftLike(600, 13);
  const auto error_of = [&](const Descriptors& centers) {
    double sum = 0;
    for (const Descriptors* image : {&a, &b}) {
      for (const Descriptor& d : *image) {
        std::int32_t least = BestTwo::kNone;
        for (const Descriptor& center : centers) least = std::min(least, test::DistanceSq(d, center));
        sum += least;
      }
    }
    return sum;
  };
  const auto centers = CellCenters(a, b, 8, ChooseKernel(""), context);
  ASSERT_EQ(centers.size(), 8U);
  EXPECT_LT(error_of(centers), 0.75 * error_of({a.begin(), a.begin() + 8}));
  // Equal descriptors: their mean is themselves, and centres that nobody is nearest to stay.
  const Descriptors equal(300, a[5]);
  EXPECT_EQ(CellCenters(equal, equal, 3, ChooseKernel(""), context), Descriptors(3, a[5]));
}

/// Descriptors in families, as those of real images are.
Descriptors Families(std::size_t count, std::uint64_t seed) {
  const Descriptors parents = test::SiftLike(60, 99);
  Rng rng(seed);
  Descriptors result(count);
  for (auto& d : result) {
    d = parents[rng.Below(60)];
    for (auto& v : d) v = static_cast<std::uint8_t>(std::clamp(v + 25 * rng.Normal(), 0.0, 255.0));
  }
  return result;
}

TEST(CellsMatching, FindsNearlyAllThatM2Finds) {
  SerialRunContext context;
  const Descriptors a = Families(16'384, 14), b = test::SecondView(a, 6, 15);
  const auto m2 = matching::Run(a, b, {.matcher = "m2"}, context);
  ASSERT_GT(m2.size(), 8000U);
  for (const bool mutual : {true, false}) {
    const auto found = matching::Run(a, b, {.mutual = mutual, .matcher = "cells", .visited_cells = 8}, context);
    std::vector<Match> both;
    std::set_intersection(found.begin(), found.end(), m2.begin(), m2.end(), std::back_inserter(both));
    EXPECT_GT(static_cast<double>(both.size()), 0.98 * static_cast<double>(m2.size()));
  }
}

}  // namespace
}  // namespace rilievo::matching
