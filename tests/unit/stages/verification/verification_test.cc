// Verification of simulated pairs against exact truth.
#include "stages/verification/verification.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>

#include "geometry/epipolar.h"
#include "tests/support/two_view_scenes.h"

namespace rilievo::verification {
namespace {

Camera MakeCamera(double k1 = 0) {
  Camera camera;
  camera.id = CameraId(0);
  camera.model = {.kind = CameraModelKind::kOpenCv,
                  .fx = 2760,
                  .fy = 2760,
                  .cx = 1536,
                  .cy = 1024,
                  .k1 = k1,
                  .k2 = -0.4 * k1,
                  .p1 = k1 / 100};
  camera.width_px = 3072;
  camera.height_px = 2048;
  return camera;
}

struct SimulatedPair {
  TwoViewScene scene;
  Camera camera;
  std::vector<Keypoint> first, second;
  std::vector<Match> matches;  // match i is right for i < scene.inliers
  Input MakeInput() const { return {{ImageId(3), ImageId(8)}, camera, camera, first, second, matches}; }
};

Keypoint PixelOf(const CameraModel& model, const Eigen::Vector2d& ideal, double noise_px, Rng& rng) {
  const Eigen::Vector2d d = model.Distort(ideal);
  Keypoint keypoint;
  keypoint.x_px = static_cast<float>(model.fx * d.x() + model.cx + noise_px * rng.Normal());
  keypoint.y_px = static_cast<float>(model.fy * d.y() + model.cy + noise_px * rng.Normal());
  return keypoint;
}

SimulatedPair MakePair(std::uint64_t seed, const TwoViewSceneOptions& options, double noise_px = 0.5, double k1 = 0) {
  Rng rng(seed);
  SimulatedPair pair{MakeTwoViewScene(rng, options), MakeCamera(k1), {}, {}, {}};
  for (std::uint32_t i = 0; i < pair.scene.first.size(); ++i) {
    pair.first.push_back(PixelOf(pair.camera.model, pair.scene.first[i], noise_px, rng));
    pair.second.push_back(PixelOf(pair.camera.model, pair.scene.second[i], noise_px, rng));
    pair.matches.push_back({i, i});
  }
  return pair;
}

TwoViewGeometry Verify(const SimulatedPair& pair, const Options& options = {}, std::uint64_t seed = 1) {
  SerialRunContext context(seed);
  return Run(pair.MakeInput(), options, context);
}

struct Score {
  double recall = 0, wrong = 0, rotation_rad = 0, direction_rad = 0;
};

Score Judge(const SimulatedPair& pair, const TwoViewGeometry& g) {
  Score s;
  double right = 0;
  for (const auto& m : g.inliers) right += m.first < pair.scene.inliers ? 1 : 0;
  s.recall = right / static_cast<double>(pair.scene.inliers);
  s.wrong = g.inliers.empty() ? 0 : 1 - right / static_cast<double>(g.inliers.size());
  const Rigid3& truth = pair.scene.second_from_first;
  s.rotation_rad = g.second_from_first.rotation.angularDistance(truth.rotation);
  const Eigen::Vector3d a = g.second_from_first.translation, b = truth.translation.normalized();
  s.direction_rad = std::atan2(a.cross(b).norm(), a.dot(b));
  return s;
}

TEST(Verification, FindsTheRelativePoseAmongOutliers) {
  for (const double outliers : {0.4, 0.6, 0.7}) {
    double wrong = 0;  // a wrong match within the band of its line cannot be told: judged on the mean
    for (std::uint64_t seed = 0; seed < 10; ++seed) {
      const auto pair = MakePair(seed, {.points = 1000, .outlier_share = outliers});
      const auto g = Verify(pair);
      ASSERT_EQ(g.model, TwoViewModel::kEssential) << ToText(g.reason);
      const Score s = Judge(pair, g);
      EXPECT_GE(s.recall, 0.95);
      wrong += s.wrong / 10;
      EXPECT_LT(s.rotation_rad, 2e-3);
      EXPECT_LT(s.direction_rad, 1e-2);
      EXPECT_NEAR(g.second_from_first.translation.norm(), 1, 1e-12);
    }
    EXPECT_LE(wrong, 0.01) << outliers;
  }
}

}  // namespace
}  // namespace rilievo::verification
