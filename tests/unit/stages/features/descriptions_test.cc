// GLOH and PCA-SIFT: against plain references, invariances, the same bytes however they are worked out, norms that the
// matching's kernels take, matches beside SIFT's.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <numbers>
#include <string>
#include <thread>

#include "base/rng.h"
#include "simulation/renderer.h"
#include "stages/features/descriptor_bytes.h"
#include "stages/features/features.h"
#include "stages/features/gloh.h"
#include "stages/features/pca_sift.h"
#include "stages/features/selection.h"
#include "stages/features/sift.h"
#include "stages/matching/matching.h"
#include "stages/matching/two_nearest.h"
#include "tests/support/blob_image.h"
#include "tests/support/reference_descriptors.h"

namespace rilievo::features {
namespace {

using testing_support::BlobTexture;

/// Beyond it the avx512 matching falls back to its slow reference (docs/decisions/0010).
constexpr int kMostSquaredNorm = matching::kLargestSignedBytes_sq;

Options OptionsFor(const std::string& detector) {
  Options options;
  options.detector = detector;
  return options;
}

ImageFeatures Detect(const GreyImage& image, const Options& options) {
  SerialRunContext context;
  return Run({image}, options, context);
}

Eigen::VectorXd Components(const Descriptor& descriptor) {
  Eigen::VectorXd components(128);
  for (std::size_t i = 0; i < 128; ++i) components(static_cast<Eigen::Index>(i)) = descriptor[i] - 128.0;
  return components;
}

/// A feature of `a` and where, how large and in what direction it must be found in another image.
struct Expected {
  Eigen::Vector2d position_px;
  double scale_px, angle_rad;
};

/// For each feature that is found again: distance of the two descriptors over the mean norm.
std::vector<double> DistancesOfTheSame(const ImageFeatures& a, const ImageFeatures& b,
                                       const std::function<Expected(const Keypoint&)>& expected) {
  std::vector<double> distances;
  for (std::size_t i = 0; i < a.keypoints.size(); ++i) {
    const Expected e = expected(a.keypoints[i]);
    for (std::size_t j = 0; j < b.keypoints.size(); ++j) {
      const Keypoint& k = b.keypoints[j];
      if ((k.Position() - e.position_px).norm() > 0.1 * e.scale_px || std::abs(k.scale_px / e.scale_px - 1) > 0.05 ||
          std::abs(std::remainder(k.angle_rad - e.angle_rad, 2 * std::numbers::pi)) > 0.05)
        continue;
      const Eigen::VectorXd p = Components(a.descriptors[i]), q = Components(b.descriptors[j]);
      distances.push_back(2 * (p - q).norm() / (p.norm() + q.norm()));
      break;
    }
  }
  std::sort(distances.begin(), distances.end());
  return distances;
}

double Quantile(const std::vector<double>& sorted, double share) {
  return sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1))];
}

class Descriptions : public testing::TestWithParam<std::string> {
 protected:
  Options options_ = OptionsFor(GetParam());
};

INSTANTIATE_TEST_SUITE_P(Kinds, Descriptions, testing::Values("gloh", "pca-sift"),
                         [](const auto& kind) { return kind.param == "gloh" ? "Gloh" : "PcaSift"; });

TEST_P(Descriptions, BelongToTheFeaturesOfSift) {
  const GreyImage image = BlobTexture(260, 200, 31);
  const ImageFeatures ours = Detect(image, options_), sift = Detect(image, OptionsFor("sift"));
  ASSERT_GT(sift.keypoints.size(), 100U);
  ASSERT_EQ(ours.keypoints.size(), sift.keypoints.size());
  for (std::size_t i = 0; i < sift.keypoints.size(); ++i)
    EXPECT_EQ(std::memcmp(&ours.keypoints[i], &sift.keypoints[i], sizeof(Keypoint)), 0);
  EXPECT_NE(ours.descriptors, sift.descriptors);
  EXPECT_FALSE(ComparesEqualSignsOnly(options_));
}

/// What the papers give, in bytes from 128 before rounding.
class Papers {
 public:
  explicit Papers(bool is_gloh)
      : is_gloh_(is_gloh),
        stored_(is_gloh ? kGlohProjection : kPcaSiftProjection),
        rows_(testing_support::ProjectionRows(stored_)),
        offsets_(testing_support::ProjectionOffsets(stored_)) {
    if (!is_gloh) rows_ = testing_support::GradientRows(rows_);
  }
  /// `gloh_step`: of the grid that GLOH is sampled on, in its units.
  Eigen::VectorXd operator()(const testing_support::ReferenceFrame& frame, double gloh_step) const {
    const Eigen::VectorXd input =
        is_gloh_ ? testing_support::ReferenceGloh(frame, gloh_step) : testing_support::ReferenceGradients(frame);
    const Eigen::VectorXd found = (is_gloh_ ? kGlohGain : kPcaSiftGain) * (rows_ * input - offsets_);
    Eigen::VectorXd padded = Eigen::VectorXd::Zero(128);
    padded.head(stored_.outputs) = found * std::min(1.0, kMostSignedNorm / found.norm());
    return padded.cwiseMax(-128).cwiseMin(127);
  }

 private:
  bool is_gloh_;
  const StoredProjection& stored_;
  Eigen::MatrixXd rows_;
  Eigen::VectorXd offsets_;
};

TEST_P(Descriptions, AreThoseOfThePaper) {
  const Papers papers(GetParam() == "gloh");
  const GreyImage image = BlobTexture(440, 360, 10);
  const ImageFeatures features = Detect(image, options_);
  // The octave of the image itself: both sample its pixels bilinearly. A feature between two layers may belong to
  // either: the one that agrees. Those between two octaves are left out.
  const double surplus = SurplusVariance_px2(0);
  std::map<std::size_t, std::pair<double, double>> least;  // error, and what a finer grid would change
  for (int layer = 1; layer <= kScales; ++layer) {
    const auto plane = testing_support::AtScale(image, LayerSigma(layer, surplus));
    for (std::size_t i = 0; i < features.keypoints.size(); ++i) {
      const Keypoint& k = features.keypoints[i];
      const double scale_sq = (k.scale_px * k.scale_px - surplus) / (kBaseSigma * kBaseSigma),
                   margin_px = 12 * k.scale_px;
      const double place = scale_sq > 0 ? 1.5 * std::log2(scale_sq) : 0;
      if (place < 1 || place > kScales || std::abs(place - layer) > 0.7 || std::min(k.x_px, k.y_px) < margin_px ||
          k.x_px > image.width_px - margin_px || k.y_px > image.height_px - margin_px)
        continue;
      const testing_support::ReferenceFrame frame{plane, k.x_px, k.y_px, k.scale_px, k.angle_rad};
      const Eigen::VectorXd expected = papers(frame, 1.5);
      const std::pair<double, double> found = {
          (Components(features.descriptors[i]) - expected).norm() / expected.norm(),
          (papers(frame, 0.4) - expected).norm() / expected.norm()};
      least.emplace(i, found);
      least[i] = std::min(least[i], found);
    }
  }
  std::vector<double> errors, coarseness;
  for (const auto& [i, found] : least) {
    errors.push_back(found.first);
    coarseness.push_back(found.second);
  }
  ASSERT_GT(errors.size(), 100U);
  std::sort(errors.begin(), errors.end());
  std::sort(coarseness.begin(), coarseness.end());
  RecordProperty("compared", std::to_string(errors.size()));
  RecordProperty("median", std::to_string(Quantile(errors, 0.5)));
  RecordProperty("97_percent", std::to_string(Quantile(errors, 0.97)));
  RecordProperty("most", std::to_string(errors.back()));
  RecordProperty("coarseness", std::to_string(Quantile(coarseness, 0.5)));
  EXPECT_LT(Quantile(errors, 0.5), 0.03);
  EXPECT_LT(Quantile(errors, 0.97), 0.05);
  // GLOH's samples 0.75 sigma apart are enough: nearly what a grid of fourteen times as many gives.
  EXPECT_LT(Quantile(coarseness, 0.5), 0.1);
}

TEST_P(Descriptions, TurnWithTheImage) {
  const GreyImage image = BlobTexture(260, 200, 5);
  const ImageFeatures before = Detect(image, options_), after = Detect(testing_support::QuarterTurn(image), options_);
  const auto distances = DistancesOfTheSame(before, after, [&](const Keypoint& k) {
    return Expected{{image.height_px - k.y_px, k.x_px}, k.scale_px, k.angle_rad + std::numbers::pi / 2};
  });
  ASSERT_GT(before.keypoints.size(), 100U);
  ASSERT_GT(static_cast<double>(distances.size()), 0.98 * static_cast<double>(before.keypoints.size()));
  RecordProperty("distance", std::to_string(Quantile(distances, 0.99)));
  EXPECT_LT(Quantile(distances, 0.99), 0.1);
}

TEST_P(Descriptions, ForgetBrightnessAndContrast) {
  const GreyImage image = BlobTexture(260, 200, 17);
  GreyImage dimmed = image;
  for (auto& v : dimmed.u8) v = static_cast<std::uint8_t>(v / 2 + 100);
  Options half = options_;
  half.contrast_threshold = 0.5 * options_.contrast_threshold;
  const ImageFeatures a = Detect(image, options_), b = Detect(dimmed, half);
  const auto distances = DistancesOfTheSame(a, b, [](const Keypoint& k) {
    return Expected{k.Position(), k.scale_px, k.angle_rad};
  });
  ASSERT_GT(static_cast<double>(distances.size()), 0.8 * static_cast<double>(a.keypoints.size()));
  RecordProperty("distance", std::to_string(Quantile(distances, 0.95)));
  EXPECT_LT(Quantile(distances, 0.95), 0.2);
}

TEST_P(Descriptions, ForgetTheScale) {
  const ImageFeatures a = Detect(BlobTexture(200, 160, 23), options_),
                      b = Detect(BlobTexture(200, 160, 23, 2.0), options_);
  const auto distances = DistancesOfTheSame(a, b, [](const Keypoint& k) {
    return Expected{2 * k.Position(), 2.0 * static_cast<double>(k.scale_px), k.angle_rad};
  });
  ASSERT_GT(distances.size(), 50U);
  RecordProperty("found", std::to_string(distances.size()));
  RecordProperty("distance", std::to_string(Quantile(distances, 0.9)));
  EXPECT_LT(Quantile(distances, 0.9), 0.25);
  // Beside that, what tells features apart: any two are several times as far from each other.
  std::vector<double> others;
  for (std::size_t i = 1; i < a.descriptors.size(); ++i) {
    const Eigen::VectorXd p = Components(a.descriptors[i - 1]), q = Components(a.descriptors[i]);
    if ((a.keypoints[i].Position() - a.keypoints[i - 1].Position()).norm() > 5)
      others.push_back(2 * (p - q).norm() / (p.norm() + q.norm()));
  }
  std::sort(others.begin(), others.end());
  EXPECT_GT(Quantile(others, 0.1), 3 * Quantile(distances, 0.9));
}

/// Every chunk on a thread of its own, at once.
class ManyThreads : public SerialRunContext {
 public:
  void ParallelFor(std::size_t n, std::size_t grain, const std::function<void(std::size_t, std::size_t)>& fn) override {
    std::vector<std::thread> threads;
    for (std::size_t begin = 0; begin < n; begin += grain)
      threads.emplace_back([&fn, begin, end = std::min(n, begin + grain)] { fn(begin, end); });
    for (auto& thread : threads) thread.join();
  }
};

TEST_P(Descriptions, TilingsAndThreadsGiveTheSameBytes) {
  const GreyImage image = BlobTexture(500, 200, 6);
  const ImageFeatures whole = Detect(image, options_);
  ASSERT_GT(whole.keypoints.size(), 100U);
  for (const int width_px : {30, 128}) {
    ManyThreads threads;
    const ImageFeatures tiled =
        features::Run({image, {}, {.strip_width_px = width_px, .chunks = 5}}, options_, threads);
    EXPECT_EQ(tiled.descriptors, whole.descriptors) << width_px;
  }
}

TEST_P(Descriptions, AllKernelsGiveTheSameBytes) {
  const GreyImage image = BlobTexture(300, 200, 16);
  SerialRunContext context;
  const SelectionRule rule{1 << 20, false, image.width_px, image.height_px};
  const Describer describe = GetParam() == "gloh" ? DescribeGloh : DescribePcaSift;
  const auto detect = [&](const SiftKernels& kernels) {
    return SelectFeatures(DetectSift({image}, {-1, {0.01, 10}, 4, describe}, rule, kernels, context), rule);
  };
  const std::vector<Feature> expected = detect(kSiftScalar);
  ASSERT_GT(expected.size(), 200U);
  for (const SiftKernels& kernels : AllSiftKernels()) {
    if (!kernels.is_supported) continue;  // by this processor
    const std::vector<Feature> found = detect(kernels);
    ASSERT_EQ(found.size(), expected.size()) << kernels.name;
    EXPECT_EQ(std::memcmp(found.data(), expected.data(), found.size() * sizeof(Feature)), 0) << kernels.name;
  }
}

TEST_P(Descriptions, FitTheKernelsOfMatchingAndHardlyEverTheLimit) {
  simulation::SceneOptions scene;
  scene.images = 2;
  scene.width_px = 700;
  scene.height_px = 500;
  scene.surface = "statue";
  const simulation::Renderer renderer(simulation::MakeScene(scene));
  const ImageFeatures features = Detect(renderer.RenderGrey(0), options_);
  ASSERT_GT(features.descriptors.size(), 500U);
  std::size_t limited = 0;
  double sum = 0;
  for (const Descriptor& descriptor : features.descriptors) {
    const Eigen::VectorXd c = Components(descriptor);
    EXPECT_LE(c.squaredNorm(), kMostSquaredNorm);
    sum += c.norm();
    limited += c.norm() > kMostSignedNorm - 3 || c.maxCoeff() == 127 || c.minCoeff() == -128 ? 1U : 0U;
  }
  const auto count = static_cast<double>(features.descriptors.size());
  RecordProperty("mean_norm", std::to_string(sum / count));
  RecordProperty("limited", std::to_string(static_cast<double>(limited) / count));
  EXPECT_GT(sum / count, 128);  // rounding, 3.3 in 128 components, is a few percent of it
  EXPECT_LT(static_cast<double>(limited), 0.05 * count);
}

TEST(SignedBytes, AreNearestIntegersOfAVectorThatFits) {
  Rng rng(4);
  for (const float size : {1.0F, 12.0F, 23.0F, 40.0F, 3000.0F}) {
    float values[128];
    Eigen::VectorXd given(128);
    for (int i = 0; i < 128; ++i) given(i) = values[i] = size * static_cast<float>(rng.Normal());
    const Descriptor bytes = SignedBytes(values, 128);
    const Eigen::VectorXd expected = given * std::min(1.0, kMostSignedNorm / given.norm());
    EXPECT_LE((Components(bytes) - expected.cwiseMax(-128).cwiseMin(127)).cwiseAbs().maxCoeff(), 0.5001) << size;
    EXPECT_LE(Components(bytes).squaredNorm(), kMostSquaredNorm) << size;
  }
  float values[64] = {0, 250, -250};
  EXPECT_EQ(SignedBytes(values, 64)[1], 255);
  EXPECT_EQ(SignedBytes(values, 64)[2], 0);
  EXPECT_EQ(SignedBytes(values, 64)[127], 128);
}

TEST_P(Descriptions, MatchAsManyFeaturesAsSift) {
  simulation::SceneOptions scene;
  scene.images = 2;
  scene.width_px = 700;
  scene.height_px = 500;
  scene.angle_step_deg = 15;
  const simulation::Renderer renderer(simulation::MakeScene(scene));
  const GreyImage first = renderer.RenderGrey(0), second = renderer.RenderGrey(1);
  const auto correct_and_all = [&](const Options& options) {
    SerialRunContext context;
    const ImageFeatures a = Detect(first, options), b = Detect(second, options);
    std::pair<int, int> counts;
    for (const Match& m : matching::Run(a.descriptors, b.descriptors, {.ratio = 0.8, .mutual = true}, context)) {
      const auto point = renderer.SurfacePoint(0, a.keypoints[m.first].Position());
      const auto there = point ? renderer.Project(1, *point) : std::nullopt;
      counts.first += there && (*there - b.keypoints[m.second].Position()).norm() < 3 ? 1 : 0;
      ++counts.second;
    }
    return counts;
  };
  const auto [sift, sift_all] = correct_and_all(OptionsFor("sift"));
  const auto [ours, ours_all] = correct_and_all(options_);
  RecordProperty("correct", std::to_string(ours) + " of " + std::to_string(ours_all) + ", SIFT " +
                                std::to_string(sift) + " of " + std::to_string(sift_all));
  ASSERT_GT(sift, 300);
  EXPECT_GT(ours, 0.8 * sift);
  EXPECT_GT(ours, 0.97 * ours_all);
}

}  // namespace
}  // namespace rilievo::features
