// Refinements of E, F and H: they reach the minimum of their own distance, from far enough away, and never rise.
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "geometry/epipolar.h"
#include "geometry/essential_refinement.h"
#include "geometry/fundamental_refinement.h"
#include "geometry/homography_refinement.h"
#include "geometry/solvers/homography.h"
#include "tests/support/two_view_scenes.h"

namespace rilievo {
namespace {

constexpr CoordinateVariances kVariances{.first = 1.3e-7, .second = 2.1e-7};

double SampsonCost(const Eigen::Matrix3d& m, const TwoViewScene& scene) {
  double cost = 0;
  for (std::size_t i = 0; i < scene.first.size(); ++i)
    cost += SquaredSampson(m, scene.first[i], scene.second[i], kVariances);
  return cost;
}

double TransferCost(const Eigen::Matrix3d& h, const TwoViewScene& scene) {
  double cost = 0;
  for (std::size_t i = 0; i < scene.first.size(); ++i) {
    cost += SquaredTransfer(h, h.inverse(), scene.first[i], scene.second[i], kVariances);
  }
  return cost;
}

Eigen::Matrix3d Turn(Rng& rng, double angle) {
  return Eigen::AngleAxisd(angle, RandomDirection(rng)).toRotationMatrix();
}

TEST(RefineEssential, NoNearbyEssentialMatrixIsBetter) {
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    Rng rng(seed);
    const auto scene = MakeTwoViewScene(rng, {.points = 60, .planar = seed % 3 == 0, .noise = 2e-4});
    const Eigen::Matrix3d start = Turn(rng, 0.01) * scene.Essential() * Turn(rng, 0.01);
    const auto refined = RefineEssential(PairArrays(scene.first, scene.second), kVariances, start);
    ASSERT_TRUE(refined);
    const double cost = SampsonCost(*refined, scene);
    EXPECT_LE(cost, 1.001 * SampsonCost(scene.Essential(), scene));
    for (int k = 0; k < 20; ++k) {
      EXPECT_LE(cost, SampsonCost(Turn(rng, 1e-5) * *refined * Turn(rng, 1e-5), scene) * (1 + 1e-7));
    }
  }
}

TEST(RefineFundamental, NoNearbyMatrixOfRankTwoIsBetter) {
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    Rng rng(seed);
    const auto scene = MakeTwoViewScene(rng, {.points = 60, .noise = 2e-4});
    const auto deform = [&](double by) {
      Eigen::Matrix3d m = Eigen::Matrix3d::Identity();
      for (int i = 0; i < 9; ++i) m(i / 3, i % 3) += by * rng.Normal();
      return m;
    };
    const Eigen::Matrix3d start = deform(0.005) * scene.Essential() * deform(0.005);
    const auto refined = RefineFundamental(PairArrays(scene.first, scene.second), kVariances, start);
    ASSERT_TRUE(refined);
    EXPECT_NEAR(refined->determinant(), 0, 1e-12);
    const double cost = SampsonCost(*refined, scene);
    EXPECT_LE(cost, SampsonCost(scene.Essential(), scene));  // the truth is one of the matrices
    for (int k = 0; k < 20; ++k)
      EXPECT_LE(cost, SampsonCost(deform(1e-5) * *refined * deform(1e-5), scene) * (1 + 1e-7));
  }
}

TEST(RefineHomography, NoNearbyHomographyIsBetterNorTheLinearOne) {
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    Rng rng(seed);
    const auto scene = MakeTwoViewScene(rng, {.points = 40, .planar = true, .noise = 2e-4});
    const auto linear = SolveHomographyLinear(scene.first, scene.second);
    ASSERT_TRUE(linear);
    Eigen::Matrix3d start = *linear;
    for (int i = 0; i < 9; ++i) start(i / 3, i % 3) += 1e-3 * rng.Normal();
    const auto refined = RefineHomography(PairArrays(scene.first, scene.second), kVariances, -start);
    ASSERT_TRUE(refined);
    const double cost = TransferCost(*refined, scene);
    EXPECT_LE(cost, TransferCost(*linear, scene));
    for (int k = 0; k < 20; ++k) {
      Eigen::Matrix3d other = *refined;
      for (int i = 0; i < 9; ++i) other(i / 3, i % 3) += 1e-6 * rng.Normal();
      EXPECT_LE(cost, TransferCost(other, scene) * (1 + 1e-7));
    }
  }
}

TEST(Refinement, SaysNothingOfTooFewPointsOrOfBrokenStarts) {
  Rng rng(1);
  const auto scene = MakeTwoViewScene(rng, {.points = 20});
  const PairArrays pairs(scene.first, scene.second),
      few(std::span(scene.first).first(3), std::span(scene.second).first(3));
  Eigen::Matrix3d broken = scene.Essential();
  EXPECT_FALSE(RefineEssential(few, kVariances, broken));
  EXPECT_FALSE(RefineFundamental(few, kVariances, broken));
  EXPECT_FALSE(RefineHomography(few, kVariances, Eigen::Matrix3d::Identity()));
  broken(1, 1) = std::nan("");
  EXPECT_FALSE(RefineEssential(pairs, kVariances, broken));
  EXPECT_FALSE(RefineFundamental(pairs, kVariances, broken));
  EXPECT_FALSE(RefineHomography(pairs, kVariances, broken));
  EXPECT_FALSE(RefineFundamental(pairs, kVariances, Eigen::Matrix3d::Zero()));
  EXPECT_FALSE(RefineHomography(pairs, kVariances, Eigen::Matrix3d::Zero()));
}

}  // namespace
}  // namespace rilievo
