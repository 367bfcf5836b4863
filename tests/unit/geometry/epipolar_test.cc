// Poses and essential matrices, distances, and the refinement of E.
#include "geometry/epipolar.h"

#include <gtest/gtest.h>

#include "geometry/essential_refinement.h"
#include "geometry/robust/significance.h"
#include "tests/support/two_view_scenes.h"

namespace rilievo {
namespace {

TEST(Epipolar, PoseSurvivesTheEssentialMatrix) {
  for (std::uint64_t seed = 0; seed < 500; ++seed) {
    Rng rng(seed);
    const auto scene = MakeTwoViewScene(rng, {.points = 20});
    const auto selected = SelectPose(scene.Essential(), scene.first, scene.second);
    EXPECT_EQ(selected.in_front, 20U);
    EXPECT_LT(selected.second_from_first.rotation.angularDistance(scene.second_from_first.rotation), 1e-7);
    EXPECT_LT((selected.second_from_first.translation - scene.second_from_first.translation.normalized()).norm(), 1e-7);
  }
}

TEST(Epipolar, SampsonIsTheDistanceToFirstOrder) {
  // Moving a point across its line by d changes Sampson's distance to d / sqrt(2) when both images share the correction
  // alike.
  Rigid3 sideways;
  sideways.translation = {1, 0, 0};  // lines are rows
  const Eigen::Matrix3d e = EssentialFromPose(sideways);
  const double d = 1e-3;
  EXPECT_NEAR(SquaredSampson(e, {0.1, 0.2}, {0.3, 0.2 + d}), d * d / 2, 1e-15);
  EXPECT_NEAR(SquaredEpipolarDistances(e, {0.1, 0.2}, {0.3, 0.2 + d}), 2 * d * d, 1e-15);
  EXPECT_NEAR(SquaredSampson(e, {0.1, 0.2}, {0.3, 0.2 + d}, {1e-6, 1e-6}), 0.5, 1e-9);  // a focal length of 1000 px
}

TEST(EssentialRefinement, ReachesTheMinimumFromNearby) {
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    Rng rng(seed);
    const auto scene = MakeTwoViewScene(rng, {.points = 60, .noise = 2e-4});
    const auto cost = [&](const Eigen::Matrix3d& e) {
      double sum = 0;
      for (std::size_t i = 0; i < 60; ++i) sum += SquaredSampson(e, scene.first[i], scene.second[i]);
      return sum;
    };
    const Rigid3 off(
        Eigen::Quaterniond(Eigen::AngleAxisd(0.01, RandomDirection(rng))) * scene.second_from_first.rotation,
        (scene.second_from_first.translation + 0.02 * RandomDirection(rng)).normalized());
    const auto refined = RefineEssential(PairArrays(scene.first, scene.second), {}, EssentialFromPose(off));
    ASSERT_TRUE(refined);
    EXPECT_LT(cost(*refined), cost(scene.Essential()));
    // No neighbouring essential matrix is better.
    const Rigid3 pose = DecomposeEssential(*refined)[0];
    for (int k = 0; k < 20; ++k) {
      const Rigid3 near(Eigen::Quaterniond(Eigen::AngleAxisd(1e-4, RandomDirection(rng))) * pose.rotation,
                        (pose.translation + 1e-4 * RandomDirection(rng)).normalized());
      EXPECT_GE(cost(EssentialFromPose(near)), cost(*refined) * (1 - 1e-9));
    }
  }
}

TEST(Significance, TailIsTheBinomialOne) {
  // P(X >= 2) of 3 draws at 0.5 is a half.
  EXPECT_NEAR(LogFalseAlarms(7, 8, 5, 0.5, 1), std::log(0.5), 1e-12);
  EXPECT_NEAR(LogFalseAlarms(7, 8, 5, 0.5, 100), std::log(50.0), 1e-12);
  EXPECT_GT(LogFalseAlarms(5, 100, 5, 0.01, 1), 1e300);
}

}  // namespace
}  // namespace rilievo
