// Verification of simulated pairs against exact truth.
#include "stages/verification/verification.h"

#include <gtest/gtest.h>

#include <algorithm>
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

class EachEstimator : public testing::TestWithParam<const char*> {};

TEST_P(EachEstimator, StandsFortyPercentOutliersInGeneralAndPlanarScenes) {
  for (const bool planar : {false, true}) {
    double wrong = 0;
    for (std::uint64_t seed = 0; seed < 10; ++seed) {
      const auto pair = MakePair(seed, {.points = 600, .planar = planar, .outlier_share = 0.4});
      const auto g = Verify(pair, {.estimator = GetParam()});
      ASSERT_EQ(g.model, planar ? TwoViewModel::kHomography : TwoViewModel::kEssential);
      const Score s = Judge(pair, g);
      EXPECT_GE(s.recall, 0.95);
      wrong += s.wrong / 10;
      EXPECT_NEAR(g.second_from_first.translation.norm(), 1, 1e-12);
      if (planar) {
        EXPECT_GT(g.homography_ratio, 0.9);
      } else {
        EXPECT_LT(g.homography_ratio, 0.5);
        EXPECT_LT(s.direction_rad, 1e-2);
      }
    }
    EXPECT_LE(wrong, 0.01);
  }
}

INSTANTIATE_TEST_SUITE_P(Verification, EachEstimator, testing::Values("ransac", "lmeds", "mapsac"));

TEST(Verification, LmedsBreaksDownBeyondHalfOutliersWhereMapsacStands) {
  int lmeds = 0, mapsac = 0;
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const auto pair = MakePair(seed, {.points = 500, .outlier_share = 0.65});
    const auto good = [&](const TwoViewGeometry& g) {
      return g.IsVerified() && Judge(pair, g).recall > 0.95 && Judge(pair, g).wrong < 0.03;
    };
    lmeds += good(Verify(pair, {.estimator = "lmeds"}));
    mapsac += good(Verify(pair));
  }
  EXPECT_EQ(mapsac, 10);
  EXPECT_LE(lmeds, 1);
}

TEST(Verification, UndoesDistortion) {
  const auto pair = MakePair(3, {.points = 500, .outlier_share = 0.3}, 0.3, -0.15);
  const auto g = Verify(pair);
  ASSERT_TRUE(g.IsVerified());
  EXPECT_GE(Judge(pair, g).recall, 0.98);
  EXPECT_LT(Judge(pair, g).direction_rad, 5e-3);
  auto ignorant = pair;
  ignorant.camera = MakeCamera(0);
  EXPECT_LT(Judge(ignorant, Verify(ignorant)).recall, 0.9);
}

TEST(Verification, UnrelatedImagesDoNotPass) {
  int passed = 0;
  for (std::uint64_t seed = 0; seed < 1000; ++seed) {
    Rng rng(SeedFor(77, seed));
    const std::size_t n = seed % 25 == 0 ? 2000 + rng.Below(3000) : 200 + rng.Below(300);
    const auto pair = MakePair(seed, {.points = n, .outlier_share = 1});
    Options options;
    options.max_trials = 200;  // keeps the test short; the bound on chance counts the trials made
    passed += Verify(pair, options).IsVerified();
  }
  EXPECT_EQ(passed, 0);
}

TEST(Verification, UnrelatedImagesDoNotPassAfterAllTrialsEither) {
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const auto pair = MakePair(seed, {.points = seed < 8 ? 60U + 50U * seed : 3000U, .outlier_share = 1});
    auto guessed = pair;
    guessed.camera.source = CalibrationSource::kGuessed;
    EXPECT_FALSE(Verify(pair).IsVerified());
    EXPECT_FALSE(Verify(guessed).IsVerified());
  }
}

TEST(Verification, FewButTrueMatchesPass) {
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    EXPECT_TRUE(Verify(MakePair(seed, {.points = 20})).IsVerified());
    EXPECT_TRUE(Verify(MakePair(seed, {.points = 60, .outlier_share = 0.6})).IsVerified()) << seed;
  }
}

TEST(Verification, RotationOnlyIsRecognised) {
  for (const double outliers : {0.0, 0.4}) {
    for (std::uint64_t seed = 0; seed < 5; ++seed) {
      const auto pair = MakePair(seed, {.points = 500, .outlier_share = outliers, .baseline = 0});
      const auto g = Verify(pair);
      ASSERT_EQ(g.model, TwoViewModel::kHomography);
      EXPECT_EQ(g.second_from_first.translation.norm(), 0);
      EXPECT_LT(Judge(pair, g).rotation_rad, 1e-3);
      EXPECT_LT(g.median_angle_rad, 1e-3);
      EXPECT_GE(Judge(pair, g).recall, 0.95);
      EXPECT_TRUE(g.matrix.allFinite());
    }
  }
}

TEST(Verification, IdenticalImagesHaveNoParallax) {
  auto pair = MakePair(1, {.points = 300});
  pair.second = pair.first;
  const auto g = Verify(pair);
  ASSERT_EQ(g.model, TwoViewModel::kHomography);
  EXPECT_EQ(g.second_from_first.translation.norm(), 0);
  EXPECT_LT(g.second_from_first.rotation.angularDistance(Eigen::Quaterniond::Identity()), 1e-7);
  EXPECT_LT(g.median_angle_rad, 1e-6);
  EXPECT_EQ(g.inliers.size(), 300U);
}

TEST(Verification, MedianAngleIsThatOfTheTruth) {
  const auto pair = MakePair(5, {.points = 400});
  std::vector<double> angles;
  for (std::size_t i = 0; i < 400; ++i) {
    angles.push_back(IntersectRays(pair.scene.second_from_first, pair.scene.first[i], pair.scene.second[i]).angle_rad);
  }
  std::sort(angles.begin(), angles.end());
  EXPECT_NEAR(Verify(pair).median_angle_rad / angles[200], 1, 0.02);
}

TEST(Verification, WrongGuessOfTheFocalLengthGivesF) {
  auto pair = MakePair(4, {.points = 500, .outlier_share = 0.3}, 0.3);
  pair.camera.model.fx = pair.camera.model.fy = 4500;
  pair.camera.source = CalibrationSource::kGuessed;
  const auto g = Verify(pair);
  ASSERT_EQ(g.model, TwoViewModel::kFundamental);
  EXPECT_GE(Judge(pair, g).recall, 0.95);
  double worst = 0;  // F holds for pixels
  for (const auto& m : g.inliers) {
    worst = std::max(worst, SquaredSampson(g.matrix, pair.first[m.first].Position(), pair.second[m.second].Position()));
  }
  EXPECT_LT(worst, 2.01 * 2.01);
  pair.camera = MakeCamera();
  pair.camera.source = CalibrationSource::kGuessed;
  EXPECT_EQ(Verify(pair).model, TwoViewModel::kEssential);
}

TEST(Verification, IsAFunctionOfInputAndSeed) {
  const auto pair = MakePair(6, {.points = 700, .outlier_share = 0.5});
  const auto a = Verify(pair, {}, 5), b = Verify(pair, {}, 5);
  EXPECT_EQ(a.inliers, b.inliers);
  EXPECT_EQ(a.matrix, b.matrix);
  EXPECT_EQ(a.second_from_first.translation, b.second_from_first.translation);
  EXPECT_TRUE(std::is_sorted(a.inliers.begin(), a.inliers.end()));
}

TEST(Verification, KeypointsOfOnePositionCountOnce) {
  // 14 true positions, each matched five times: 70 matches, but too few for min_inliers = 15.
  auto pair = MakePair(2, {.points = 14});
  for (int copy = 1; copy < 5; ++copy) {
    for (std::uint32_t i = 0; i < 14; ++i) {
      pair.first.push_back(pair.first[i]);
      pair.second.push_back(pair.second[i]);
      pair.matches.push_back(
          {static_cast<std::uint32_t>(pair.first.size() - 1), static_cast<std::uint32_t>(pair.second.size() - 1)});
    }
  }
  EXPECT_EQ(Verify(pair).reason, RejectionReason::kTooFewMatches);
  // All of a position's matches are inliers once it is one.
  auto more = MakePair(2, {.points = 40});
  more.first.push_back(more.first[0]);
  more.second.push_back(more.second[0]);
  more.matches.push_back({40, 40});
  EXPECT_EQ(Verify(more).inliers.size(), 41U);
}

TEST(Verification, DegenerateInputIsRejectedWithAReason) {
  for (const std::size_t n : {0U, 1U, 7U}) {
    EXPECT_EQ(Verify(MakePair(1, {.points = n})).reason, RejectionReason::kTooFewMatches);
  }
  auto same = MakePair(1, {.points = 200});
  for (auto& k : same.first) k.x_px = k.y_px = 700;
  for (auto& k : same.second) k.x_px = k.y_px = 900;
  EXPECT_EQ(Verify(same).reason, RejectionReason::kTooFewMatches);
  auto fan = MakePair(1, {.points = 200});  // one point of the first image matched to everything
  for (auto& k : fan.first) k.x_px = k.y_px = 700;
  EXPECT_FALSE(Verify(fan).IsVerified());
  auto line = MakePair(1, {.points = 200});  // all on a line in both images
  for (auto& k : line.first) k.y_px = 0.25F * k.x_px + 300;
  for (auto& k : line.second) k.y_px = -0.5F * k.x_px + 1900;
  EXPECT_FALSE(Verify(line).IsVerified());
  auto broken = MakePair(1, {.points = 100});
  for (std::size_t i = 0; i < 100; ++i) broken.first[i].x_px = i % 2 ? NAN : INFINITY;
  EXPECT_EQ(Verify(broken).reason, RejectionReason::kTooFewMatches);
}

TEST(Verification, NothingIsEverNan) {
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    Rng rng(seed);
    auto pair = MakePair(seed, {.points = 12 + rng.Below(60),
                                .planar = seed % 2 == 0,
                                .outlier_share = rng.Uniform(),
                                .baseline = rng.Uniform(0, 0.05)});
    if (seed % 3 == 0) {  // a coarse grid: many collinear and repeated positions
      for (auto* side : {&pair.first, &pair.second}) {
        for (auto& k : *side) k.x_px = 500 * std::round(k.x_px / 500), k.y_px = 500 * std::round(k.y_px / 500);
      }
    }
    for (const char* estimator : {"ransac", "lmeds", "mapsac"}) {
      const auto g = Verify(pair, {.estimator = estimator, .max_trials = 300, .min_inliers = 8});
      EXPECT_TRUE(g.matrix.allFinite());
      EXPECT_TRUE(g.second_from_first.translation.allFinite());
      EXPECT_TRUE(g.second_from_first.rotation.coeffs().allFinite());
      EXPECT_TRUE(std::isfinite(g.median_angle_rad) && std::isfinite(g.homography_ratio));
      EXPECT_EQ(g.IsVerified(), g.reason == RejectionReason::kNone);
    }
  }
}

TEST(Verification, TwoDifferentCamerasAreJudgedEachInItsPixels) {
  Rng rng(9);
  const auto scene = MakeTwoViewScene(rng, {.points = 500});
  Camera wide = MakeCamera(), tele = MakeCamera();
  wide.model.fx = wide.model.fy = 900;
  SimulatedPair pair{scene, wide, {}, {}, {}};
  for (std::uint32_t i = 0; i < 500; ++i) {
    pair.first.push_back(PixelOf(wide.model, scene.first[i], 0.5, rng));
    pair.second.push_back(PixelOf(tele.model, scene.second[i], 0.5, rng));
    pair.matches.push_back({i, i});
  }
  SerialRunContext context;
  const auto g = verification::Run({{ImageId(0), ImageId(1)}, wide, tele, pair.first, pair.second, pair.matches},
                                   {.threshold_px = 1.5}, context);
  EXPECT_GE(Judge(pair, g).recall, 0.98);  // three standard deviations in whichever image is the coarser
}

TEST(Verification, OptionsAreDeclaredAndInRange) {
  Options options;
  ValidateOptions(options, OptionDeclarations());
  options.estimator = "guess";
  EXPECT_THROW(ValidateOptions(options, OptionDeclarations()), Error);
}

}  // namespace
}  // namespace rilievo::verification
