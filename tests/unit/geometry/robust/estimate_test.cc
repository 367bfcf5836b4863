// The robust loop on the smallest problem there is, a line through points, against known inliers.
#include "geometry/robust/estimate.h"

#include <gtest/gtest.h>

#include <set>

#include "geometry/solvers/model_list.h"

namespace rilievo {
namespace {

struct Line {
  double slope = 0, offset = 0;
};

struct LineProblem {
  using Model = Line;
  static constexpr int kSampleSize = 2;
  std::vector<std::array<double, 2>> points;

  std::size_t Size() const { return points.size(); }
  ModelList<Line, 1> Solve(const std::array<std::uint32_t, 2>& s) const {
    ModelList<Line, 1> models;
    const auto& [ax, ay] = points[s[0]];
    const auto& [bx, by] = points[s[1]];
    if (ax != bx) models.Add({(by - ay) / (bx - ax), ay - (by - ay) / (bx - ax) * ax});
    return models;
  }
  double SquaredResidual(const Line& line, std::size_t i) const {
    const double r = points[i][1] - line.slope * points[i][0] - line.offset;
    return r * r;
  }
  std::optional<Line> Refine(std::span<const std::uint32_t> items, const Line&) const {
    double n = 0, x = 0, y = 0, xx = 0, xy = 0;
    for (const auto i : items) {
      const auto& [px, py] = points[i];
      n += 1, x += px, y += py, xx += px * px, xy += px * py;
    }
    const double det = n * xx - x * x;
    if (det == 0) return std::nullopt;
    return Line{(n * xy - x * y) / det, (xx * y - x * xy) / det};
  }
};

/// The first `good` points lie on y = 0.7 x + 3 with this noise, the others anywhere.
LineProblem MakeLine(std::size_t n, std::size_t good, double noise, std::uint64_t seed) {
  Rng rng(seed);
  LineProblem problem;
  for (std::size_t i = 0; i < n; ++i) {
    const double x = rng.Uniform(-100, 100);
    problem.points.push_back({x, i < good ? 0.7 * x + 3 + noise * rng.Normal() : rng.Uniform(-100, 100)});
  }
  return problem;
}

class EachEstimator : public testing::TestWithParam<RobustEstimator> {};

TEST_P(EachEstimator, FindsTheInliersAmongFortyPercentOutliers) {
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    const auto problem = MakeLine(500, 300, 0.1, seed);
    const auto result = EstimateRobustly(problem, {.estimator = GetParam(), .threshold = 0.4}, seed);
    ASSERT_TRUE(result);
    EXPECT_NEAR(result->model.slope, 0.7, 1e-3);
    EXPECT_NEAR(result->model.offset, 3, 0.05);
    const auto found = std::count_if(result->inliers.begin(), result->inliers.end(), [](auto i) { return i < 300; });
    EXPECT_GE(found, 285);
    EXPECT_LE(result->inliers.size() - static_cast<std::size_t>(found), 6U);
    EXPECT_TRUE(std::is_sorted(result->inliers.begin(), result->inliers.end()));
  }
}

TEST_P(EachEstimator, IsAFunctionOfItsSeed) {
  const auto problem = MakeLine(400, 230, 0.1, 5);
  const RobustOptions options{.estimator = GetParam(), .threshold = 0.4};
  const auto a = EstimateRobustly(problem, options, 9), b = EstimateRobustly(problem, options, 9);
  EXPECT_EQ(a->inliers, b->inliers);
  EXPECT_EQ(a->model.slope, b->model.slope);
  EXPECT_EQ(a->trials, b->trials);
}

TEST_P(EachEstimator, SaysNothingOfTooFewItems) {
  LineProblem problem;
  EXPECT_FALSE(EstimateRobustly(problem, {.estimator = GetParam()}, 1));
  problem.points = {{1, 1}};
  EXPECT_FALSE(EstimateRobustly(problem, {.estimator = GetParam()}, 1));
  problem.points = {{1, 1}, {1, 2}};  // a vertical line is none of the models
  EXPECT_FALSE(EstimateRobustly(problem, {.estimator = GetParam(), .max_trials = 50}, 1));
}

INSTANTIATE_TEST_SUITE_P(Robust, EachEstimator,
                         testing::Values(RobustEstimator::kRansac, RobustEstimator::kLmeds, RobustEstimator::kMapsac));

TEST(Lmeds, EstimatesTheNoiseWithoutAThreshold) {
  for (const double noise : {0.01, 0.1, 0.5}) {
    const auto result = EstimateRobustly(MakeLine(2000, 1990, noise, 3), {.estimator = RobustEstimator::kLmeds}, 1);
    EXPECT_NEAR(result->sigma0 / noise, 1, 0.15);
  }
}

TEST(Lmeds, BreaksDownBeyondHalfOutliersWhereMapsacStands) {
  int lmeds_right = 0, mapsac_right = 0;
  for (std::uint64_t seed = 0; seed < 30; ++seed) {
    // Outliers on a broad band: the median of a wrong line is as small as that of the right one.
    const auto problem = MakeLine(300, 105, 0.1, seed);
    const auto lmeds = EstimateRobustly(problem, {.estimator = RobustEstimator::kLmeds}, seed);
    const auto mapsac = EstimateRobustly(problem, {.threshold = 0.4}, seed);
    lmeds_right += lmeds->inliers.size() < 120 && std::abs(lmeds->model.slope - 0.7) < 0.005;
    mapsac_right += mapsac->inliers.size() < 120 && std::abs(mapsac->model.slope - 0.7) < 0.005;
  }
  EXPECT_EQ(mapsac_right, 30);
  EXPECT_LE(lmeds_right, 3);
}

TEST(Sampling, SamplesAreDistinctAndUniform) {
  Rng rng(4);
  std::array<int, 10> counts{};
  for (int i = 0; i < 20000; ++i) {
    const auto sample = DrawSample<5>(10, rng);
    EXPECT_EQ(std::set<std::uint32_t>(sample.begin(), sample.end()).size(), 5U);
    for (const auto index : sample) ++counts[index];
  }
  for (const int count : counts) EXPECT_NEAR(count, 10000, 400);
}

TEST(Sampling, TrialsFollowTheFormula) {
  // Large n: the published table for confidence 0.99.
  EXPECT_EQ(RequiredTrials(500000, 1000000, 7, 0.99, 100000), 588);
  EXPECT_NEAR(RequiredTrials(500000, 1000000, 5, 0.99, 100000), 146, 1);
  EXPECT_NEAR(RequiredTrials(300000, 1000000, 5, 0.99, 100000), 1893, 2);
  EXPECT_EQ(RequiredTrials(10, 10, 5, 0.99, 100), 1);
  EXPECT_EQ(RequiredTrials(4, 10, 5, 0.99, 100), 100);
  EXPECT_EQ(RequiredTrials(100, 1000, 7, 0.9999, 10000), 10000);
}

TEST(Sampling, OrdersArePermutations) {
  const auto order = ShuffledOrder(1000, 3);
  EXPECT_EQ(std::set<std::uint32_t>(order.begin(), order.end()).size(), 1000U);
  EXPECT_NE(order, ShuffledOrder(1000, 4));
}

}  // namespace
}  // namespace rilievo
