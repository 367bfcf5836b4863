// E, F and H by every estimator against known inliers, and every kernel against the scalar one to the last inlier.
#include "geometry/robust/two_view_problems.h"

#include <gtest/gtest.h>

#include <tuple>

#include "tests/support/two_view_scenes.h"

namespace rilievo {
namespace {

constexpr double kFocal_px = 2760;
constexpr CoordinateVariances kVariances{.first = 1 / (kFocal_px * kFocal_px), .second = 1 / (kFocal_px * kFocal_px)};

struct Scene {
  PointPairs pairs;
  std::vector<bool> right;  // of each item
};

Scene MakeScene(std::uint64_t seed, bool planar, double outliers, std::size_t points = 600) {
  Rng rng(seed);
  const auto scene =
      MakeTwoViewScene(rng, {.points = points, .planar = planar, .outlier_share = outliers, .noise = 0.5 / kFocal_px});
  const auto order = ShuffledOrder(points, seed);
  Scene result{PointPairs(scene.first, scene.second, kVariances).Subset(order), {}};
  for (const auto i : order) result.right.push_back(i < scene.inliers);
  return result;
}

enum class Kind { kEssential, kFundamental, kHomography };

struct Result {
  std::vector<std::uint32_t> inliers;
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();
  int trials = 0;
};

template <class P>
Result Estimate(const P& problem, const RobustOptions& options, std::uint64_t seed) {
  const auto estimate = EstimateRobustly(problem, options, seed);
  if (!estimate) return {};
  if constexpr (std::is_same_v<typename P::Model, Homography>)
    return {estimate->inliers, estimate->model.matrix, estimate->trials};
  else
    return {estimate->inliers, estimate->model, estimate->trials};
}

Result Estimate(Kind kind, const PointPairs& pairs, RobustEstimator estimator, std::uint64_t seed,
                const TwoViewKernels& kernels = ActiveTwoViewKernels()) {
  RobustOptions options{.estimator = estimator, .threshold = kind == Kind::kHomography ? 3.5 : 2.0};
  const auto residual =
      estimator == RobustEstimator::kLmeds ? EpipolarResidual::kBothDistances : EpipolarResidual::kSampson;
  if (kind == Kind::kEssential) return Estimate(EssentialProblem(pairs, residual, kernels), options, seed);
  if (kind == Kind::kFundamental) return Estimate(FundamentalProblem(pairs, residual, kernels), options, seed);
  return Estimate(HomographyProblem(pairs, kernels), options, seed);
}

struct Shares {
  double recovered = 0, wrong = 0;
};

Shares Judge(const Scene& scene, const Result& result) {
  double right = 0, all = 0;
  for (const bool r : scene.right) all += r;
  for (const auto i : result.inliers) right += scene.right[i];
  return {right / all, result.inliers.empty() ? 1 : 1 - right / static_cast<double>(result.inliers.size())};
}

class EachEstimatorAndModel : public testing::TestWithParam<std::tuple<RobustEstimator, Kind>> {};

TEST_P(EachEstimatorAndModel, StandsFortyPercentOutliers) {
  const auto [estimator, kind] = GetParam();
  for (const bool planar : {false, true}) {
    if (planar ? kind == Kind::kFundamental : kind == Kind::kHomography) continue;  // that model says nothing there
    double wrong = 0;
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
      const Scene scene = MakeScene(seed, planar, 0.4);
      const Shares s = Judge(scene, Estimate(kind, scene.pairs, estimator, seed));
      EXPECT_GE(s.recovered, 0.95) << seed;
      wrong += s.wrong / 20;
    }
    EXPECT_LE(wrong, 0.01);
  }
}

TEST_P(EachEstimatorAndModel, EveryKernelFindsTheSameToTheLastInlier) {
  const auto [estimator, kind] = GetParam();
  for (const TwoViewKernels& kernels : AllTwoViewKernels().subspan(1)) {
    if (!kernels.is_supported) continue;
    for (std::uint64_t seed = 0; seed < 4; ++seed) {
      const Scene scene = MakeScene(seed, kind == Kind::kHomography, 0.45, 300 + 37 * seed);
      const Result a = Estimate(kind, scene.pairs, estimator, seed, kTwoViewScalar);
      const Result b = Estimate(kind, scene.pairs, estimator, seed, kernels);
      EXPECT_FALSE(a.inliers.empty());
      EXPECT_EQ(a.inliers, b.inliers) << kernels.name;
      EXPECT_EQ(a.matrix, b.matrix) << kernels.name;
      EXPECT_EQ(a.trials, b.trials) << kernels.name;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(TwoViewProblems, EachEstimatorAndModel,
                         testing::Combine(testing::Values(RobustEstimator::kRansac, RobustEstimator::kLmeds,
                                                          RobustEstimator::kMapsac),
                                          testing::Values(Kind::kEssential, Kind::kFundamental, Kind::kHomography)));

TEST(EssentialProblem, MapsacStandsSeventyPercentOutliersInGeneralAndPlanarScenes) {
  for (const bool planar : {false, true}) {
    double wrong = 0;
    for (std::uint64_t seed = 0; seed < 30; ++seed) {
      const Scene scene = MakeScene(seed, planar, 0.7, 1000);
      const Shares s = Judge(scene, Estimate(Kind::kEssential, scene.pairs, RobustEstimator::kMapsac, seed));
      EXPECT_GE(s.recovered, 0.95) << planar << seed;
      wrong += s.wrong / 30;
    }
    EXPECT_LE(wrong, 0.01);
  }
}

TEST(EssentialProblem, LmedsBreaksDownBeyondHalfOutliers) {
  int good = 0;
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const Scene scene = MakeScene(seed, false, 0.65);
    const Shares s = Judge(scene, Estimate(Kind::kEssential, scene.pairs, RobustEstimator::kLmeds, seed));
    good += s.recovered > 0.95 && s.wrong < 0.03;
  }
  EXPECT_LE(good, 1);
}

}  // namespace
}  // namespace rilievo
