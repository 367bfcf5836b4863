// Forward intersection against exact rays, noise theory and planted wrong rays.
#include "geometry/triangulation.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/rng.h"
#include "base/units.h"

namespace rilievo {
namespace {

struct Scene {
  std::vector<CameraPose> poses;
  std::vector<RayView> views;
  Eigen::Vector3d point;
};

/// `n` cameras along an arc of +-20 deg at distance 5, looking at a point near the origin.
Scene MakeScene(int n, double noise_px, Rng& rng) {
  Scene scene;
  scene.point = {rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)};
  scene.poses.reserve(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i) {
    const double angle = DegToRad(-20 + 40.0 * i / (n - 1));
    const Eigen::Quaterniond q(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitY()));
    scene.poses.emplace_back(Rigid3(q, Eigen::Vector3d(rng.Uniform(-0.1, 0.1), rng.Uniform(-0.1, 0.1), 5)));
    const Eigen::Vector3d x = scene.poses.back().rotation * scene.point + scene.poses.back().translation;
    const Eigen::Vector2d noise(rng.Normal(), rng.Normal());
    scene.views.push_back({&scene.poses.back(), x.head<2>() / x.z() + noise_px / 2000 * noise, 2000});
  }
  return scene;
}

TEST(Triangulation, ExactRaysGiveThePoint) {
  Rng rng(3);
  for (int i = 0; i < 500; ++i) {
    const Scene scene = MakeScene(2 + i % 6, 0, rng);
    const auto linear = IntersectRays(scene.views);
    ASSERT_TRUE(linear);
    EXPECT_LT((*linear - scene.point).norm(), 1e-10);
    const auto refined = RefineIntersection(scene.views, scene.point + Eigen::Vector3d(0.05, -0.04, 0.1));
    ASSERT_TRUE(refined);
    EXPECT_LT((*refined - scene.point).norm(), 1e-10);
  }
}

TEST(Triangulation, RefinementIsTheMinimumOfTheResiduals) {
  Rng rng(4);
  for (int i = 0; i < 100; ++i) {
    const Scene scene = MakeScene(5, 2.0, rng);
    const auto refined = RefineIntersection(scene.views, *IntersectRays(scene.views), 10);
    ASSERT_TRUE(refined);
    const auto cost = [&](const Eigen::Vector3d& x) {
      double sum = 0;
      for (const RayView& view : scene.views) sum += std::pow(RayResidualPx(view, x), 2);
      return sum;
    };
    const double least = cost(*refined);
    for (int k = 0; k < 20; ++k)
      EXPECT_GT(cost(*refined + 1e-3 * Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal())), least);
  }
}

TEST(Triangulation, AngleIsTheOneAtThePoint) {
  const CameraPose left(Rigid3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(1, 0, 0))),
      right(Rigid3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(-1, 0, 0)));
  const RayView views[] = {{&left, {}, 1}, {&right, {}, 1}};
  EXPECT_NEAR(IntersectionAngle(views, {0, 0, 1}), DegToRad(90), 1e-12);
  EXPECT_NEAR(IntersectionAngle(views, {0, 0, 1e5}), 2e-5, 1e-12);
}

TEST(Triangulation, WrongRaysAreFound) {
  Rng rng(5);
  int exact = 0;
  for (int i = 0; i < 400; ++i) {
    const int n = 5 + i % 12, wrong = n / 3;
    Scene scene = MakeScene(n, 0.5, rng);
    std::vector<std::uint8_t> expected(static_cast<std::size_t>(n), 1);
    for (int k = 0; k < wrong; ++k) {
      const auto at = static_cast<std::size_t>((3 * k + i) % n);
      scene.views[at].normalized += Eigen::Vector2d(0, rng.Uniform(0.02, 0.2));  // across the base: 40 px and more
      expected[at] = 0;
    }
    const auto found = IntersectRobustly(scene.views, {4.0, DegToRad(1.5), static_cast<std::uint64_t>(i)});
    ASSERT_TRUE(found);
    exact += found->is_inlier == expected;
    EXPECT_LT((found->position - scene.point).norm(), 0.05);
  }
  EXPECT_EQ(exact, 400);
}

TEST(Triangulation, NoPointWithoutParallaxBehindCamerasOrFarOffTheRays) {
  Rng rng(6);
  Scene scene = MakeScene(2, 0, rng);
  const IntersectionOptions options{4.0, DegToRad(1.5), 0};
  EXPECT_TRUE(IntersectRobustly(scene.views, options));
  EXPECT_FALSE(IntersectRobustly(scene.views, {4.0, DegToRad(60), 0}));  // 40 deg apart
  EXPECT_FALSE(IntersectRobustly(std::span(scene.views).first(1), options));
  const RayView twice[] = {scene.views[0], scene.views[0]};
  EXPECT_FALSE(IntersectRobustly(twice, options));
  scene.views[0].normalized.y() += 0.05;
  EXPECT_FALSE(IntersectRobustly(scene.views, options));
  // Rays that meet behind both cameras.
  const CameraPose left(Rigid3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(1, 0, 0))),
      right(Rigid3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(-1, 0, 0)));
  const RayView diverging[] = {{&left, {-0.2, 0}, 1000}, {&right, {0.2, 0}, 1000}};
  EXPECT_FALSE(IntersectRobustly(diverging, options));
}

}  // namespace
}  // namespace rilievo
