// P3P finds the true pose among its solutions, and every solution sees the points along the rays.
#include "geometry/solvers/p3p.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "base/rng.h"

namespace rilievo {
namespace {

Rigid3 RandomPose(Rng& rng) {
  const Eigen::Quaterniond q(rng.Normal(), rng.Normal(), rng.Normal(), rng.Normal());
  return {q, Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal())};
}

TEST(P3p, TruePoseIsAmongTheSolutions) {
  Rng rng(11);
  int missed = 0;
  std::set<std::size_t> counts;
  constexpr int kCases = 20000;
  for (int i = 0; i < kCases; ++i) {
    const Rigid3 truth = RandomPose(rng);
    std::array<Eigen::Vector3d, 3> rays, points;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d x_cam(rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(0.8, 6));
      rays[k] = x_cam.normalized();
      points[k] = truth.Inverse() * x_cam;
    }
    const auto poses = SolveP3p(rays, points);
    ASSERT_LE(poses.size(), 4u);
    counts.insert(poses.size());
    double best = 1e9;
    for (const Rigid3& pose : poses) {
      best =
          std::min(best, (pose.translation - truth.translation).norm() + pose.rotation.angularDistance(truth.rotation));
      for (int k = 0; k < 3; ++k) EXPECT_LT(((pose * points[k]).normalized() - rays[k]).norm(), 1e-6);
    }
    missed += best > 1e-5;
  }
  EXPECT_LE(missed, kCases / 2000);  // only points next to the danger cylinder, where two solutions meet
  EXPECT_TRUE(counts.contains(1) && counts.contains(2) && counts.contains(4));
}

TEST(P3p, DegenerateTriplesGiveNothing) {
  const std::array<Eigen::Vector3d, 3> rays{Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(0.1, 0, 1).normalized(),
                                            Eigen::Vector3d(0.2, 0, 1).normalized()};
  EXPECT_TRUE(SolveP3p(rays, {Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(1, 0, 1), Eigen::Vector3d(2, 0, 1)}).empty());
  EXPECT_TRUE(SolveP3p(rays, {Eigen::Vector3d(1, 2, 3), Eigen::Vector3d(1, 2, 3), Eigen::Vector3d(1, 2, 3)}).empty());
}

}  // namespace
}  // namespace rilievo
