// Space resection against exact poses, wrong points and the minimum property.
#include "geometry/resection.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "base/rng.h"
#include "geometry/triangulation.h"

namespace rilievo {
namespace {

struct Scene {
  Rigid3 truth;
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector2d> normalized;
  ResectionInput Input() const { return {points, normalized, 2000}; }
};

Scene MakeScene(int n, double noise_px, double wrong_share, Rng& rng) {
  Scene scene;
  scene.truth = {Eigen::Quaterniond(rng.Normal(), rng.Normal(), rng.Normal(), rng.Normal()),
                 Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal())};
  for (int i = 0; i < n; ++i) {
    const Eigen::Vector3d x(rng.Uniform(-1.5, 1.5), rng.Uniform(-1, 1), rng.Uniform(3, 6));
    scene.points.push_back(scene.truth.Inverse() * x);
    Eigen::Vector2d p = x.head<2>() / x.z() + noise_px / 2000 * Eigen::Vector2d(rng.Normal(), rng.Normal());
    if (i < wrong_share * n) p = {rng.Uniform(-0.5, 0.5), rng.Uniform(-0.35, 0.35)};
    scene.normalized.push_back(p);
  }
  return scene;
}

TEST(Resection, HalfOfThePointsMayBeWrong) {
  Rng rng(8);
  for (int i = 0; i < 60; ++i) {
    const Scene scene = MakeScene(200, 0.5, 0.5, rng);
    const auto found = EstimateResection(scene.Input(), {}, static_cast<std::uint64_t>(i));
    ASSERT_TRUE(found);
    EXPECT_LT(found->cam_from_world.rotation.angularDistance(scene.truth.rotation), 1e-3);
    EXPECT_LT((found->cam_from_world.Center() - scene.truth.Center()).norm(), 4e-3);
    EXPECT_GE(found->inliers.size(), 100u);
    EXPECT_LE(found->inliers.size(), 103u);  // a wrong point may fall on its place
  }
}

TEST(Resection, FarFewerRightPointsThanWrongOnes) {
  Rng rng(9);
  const Scene scene = MakeScene(300, 0.5, 0.8, rng);
  const auto found = EstimateResection(scene.Input(), {}, 1);
  ASSERT_TRUE(found);
  EXPECT_LT((found->cam_from_world.Center() - scene.truth.Center()).norm(), 8e-3);
}

TEST(Resection, RefinementMinimisesTheResiduals) {
  Rng rng(10);
  for (int i = 0; i < 30; ++i) {
    const Scene scene = MakeScene(40, 1.0, 0, rng);
    std::vector<std::uint32_t> all(40);
    std::iota(all.begin(), all.end(), 0U);
    const Rigid3 start{scene.truth.rotation * Eigen::Quaterniond(Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitX())),
                       scene.truth.translation + Eigen::Vector3d(0.1, 0.1, -0.1)};
    const auto refined = RefineResection(scene.Input(), all, start, 0);
    ASSERT_TRUE(refined);
    const auto cost = [&](const Rigid3& pose) {
      const CameraPose camera(pose);
      double sum = 0;
      for (std::size_t k = 0; k < 40; ++k)
        sum += std::pow(RayResidualPx({&camera, scene.normalized[k], 2000}, scene.points[k]), 2);
      return sum;
    };
    const double least = cost(*refined);
    for (int k = 0; k < 12; ++k) {
      Eigen::Vector3d turn = Eigen::Vector3d::Zero(), shift = Eigen::Vector3d::Zero();
      (k < 6 ? turn : shift)[k % 3] = k % 6 < 3 ? 1e-4 : -1e-4;
      const Eigen::Quaterniond q(1, turn.x() / 2, turn.y() / 2, turn.z() / 2);
      EXPECT_GT(cost({q * refined->rotation, refined->translation + shift}), least);
    }
  }
}

TEST(Resection, TooFewOrMeaninglessPointsGiveNothing) {
  Rng rng(12);
  EXPECT_FALSE(EstimateResection(MakeScene(3, 0, 0, rng).Input(), {}, 1));
  Scene same = MakeScene(20, 0, 0, rng);
  for (auto& p : same.points) p = same.points[0];
  EXPECT_FALSE(EstimateResection(same.Input(), {}, 1));
}

}  // namespace
}  // namespace rilievo
