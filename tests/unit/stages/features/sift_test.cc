// SIFT: positions in the pixel frame, descriptors against a plain reference, the same bytes however it is worked
// through, the cut, memory against the estimate.
#include "stages/features/sift.h"

#include <gtest/gtest.h>
#include <malloc.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>
#include <thread>
#include <tuple>

#include "base/rng.h"
#include "stages/features/features.h"
#include "stages/features/selection.h"
#include "tests/support/blob_image.h"
#include "tests/support/reference_sift.h"

namespace rilievo::features {
namespace {

using testing_support::Blob;
using testing_support::QuarterTurn;

constexpr auto Render = testing_support::RenderBlobs;

GreyImage Texture(int width_px, int height_px, std::uint64_t seed) {
  return testing_support::BlobTexture(width_px, height_px, seed);
}

ImageFeatures Detect(const GreyImage& image, const Options& options = {}) {
  SerialRunContext context;
  return Run({image}, options, context);
}

Options OptionsWith(int max_features) {
  Options options;
  options.max_features = max_features;
  return options;
}

auto Values(const Keypoint& k) {
  return std::make_tuple(k.y_px, k.x_px, k.scale_px, k.angle_rad, k.response, k.cov_xx_px2, k.cov_xy_px2, k.cov_yy_px2,
                         k.sign);
}

bool SameFeatures(const ImageFeatures& a, const ImageFeatures& b) {
  return a.descriptors == b.descriptors && a.colors == b.colors &&
         std::equal(a.keypoints.begin(), a.keypoints.end(), b.keypoints.begin(), b.keypoints.end(),
                    [](const Keypoint& p, const Keypoint& q) { return Values(p) == Values(q); });
}

class SiftBlobs : public testing::TestWithParam<double> {};

TEST_P(SiftBlobs, PositionsAreUnbiasedAndScalesAreThoseOfTheBlobs) {
  const double sigma_px = GetParam();
  const int grid = 9;
  const double spacing_px = 12 * sigma_px + 6;
  const int side_px = static_cast<int>(spacing_px * grid);
  const double jitter_px = std::max(2.0, sigma_px);  // more than the sampling of the octave
  Rng rng(SeedFor(3, static_cast<int>(10 * sigma_px)));
  std::vector<Blob> blobs;
  for (int i = 0; i < grid * grid; ++i) {
    blobs.push_back({(i % grid + 0.5) * spacing_px + rng.Uniform(-jitter_px, jitter_px),
                     (i / grid + 0.5) * spacing_px + rng.Uniform(-jitter_px, jitter_px), sigma_px,
                     i % 2 == 0 ? 100.0 : -90.0});
  }
  const ImageFeatures features = Detect(Render(side_px, side_px, blobs));
  double sum_x = 0, sum_y = 0, worst = 0;
  int found = 0;
  for (const Blob& blob : blobs) {
    const Keypoint* nearest = nullptr;
    for (const Keypoint& k : features.keypoints) {
      const bool has_scale = k.scale_px > 0.6 * sigma_px && k.scale_px < 1.4 * sigma_px;
      if (!has_scale || std::hypot(k.x_px - blob.x_px, k.y_px - blob.y_px) > 0.5 + 0.2 * sigma_px) continue;
      nearest = &k;
      break;
    }
    if (nearest == nullptr) continue;
    ++found;
    sum_x += nearest->x_px - blob.x_px;
    sum_y += nearest->y_px - blob.y_px;
    worst = std::max(worst, std::hypot(nearest->x_px - blob.x_px, nearest->y_px - blob.y_px));
  }
  RecordProperty("mean_x_px", std::to_string(sum_x / found));
  RecordProperty("found", found);
  RecordProperty("worst_px", std::to_string(worst));
  RecordProperty("mean_y_px", std::to_string(sum_y / found));
  ASSERT_GE(found, grid * grid * 9 / 10);
  EXPECT_LT(std::abs(sum_x / found), 0.02);
  EXPECT_LT(std::abs(sum_y / found), 0.02);
  EXPECT_LT(worst, 0.1 + 0.03 * sigma_px);
}

INSTANTIATE_TEST_SUITE_P(Octaves, SiftBlobs, testing::Values(1.4, 2.0, 3.1, 5.0, 9.0));

TEST(Sift, AQuarterTurnOfTheImageTurnsPositionsAndAngles) {
  const GreyImage image = Texture(260, 200, 5);
  const ImageFeatures before = Detect(image), after = Detect(QuarterTurn(image));
  ASSERT_GT(before.keypoints.size(), 100U);
  int found = 0;
  Eigen::Vector2d sum(0, 0);
  for (const Keypoint& k : before.keypoints) {
    const Eigen::Vector2d expected(image.height_px - k.y_px, k.x_px);
    for (const Keypoint& t : after.keypoints) {
      const double turn = std::remainder(t.angle_rad - k.angle_rad - std::numbers::pi / 2, 2 * std::numbers::pi);
      if ((t.Position() - expected).norm() > 0.03 * k.scale_px || std::abs(turn) > 0.03 ||
          std::abs(t.scale_px / k.scale_px - 1) > 0.01)
        continue;
      ++found;
      sum += t.Position() - expected;
      break;
    }
  }
  EXPECT_GE(found, 0.99 * static_cast<double>(before.keypoints.size()));
  EXPECT_LT((sum / found).norm(), 0.001);
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

TEST(Sift, TilingsAndThreadsGiveTheSameBytes) {
  const GreyImage image = Texture(700, 300, 6);
  for (const int first_octave : {-1, 0}) {
    for (const std::string choice : {"strongest", "spread"}) {
      Options options;
      options.first_octave = first_octave;
      options.choice = choice;
      options.max_features = 700;
      SerialRunContext serial;
      const ImageFeatures whole = features::Run({image, {}, {.strip_width_px = 1400, .chunks = 1}}, options, serial);
      ASSERT_GT(whole.keypoints.size(), 100U);
      // 2 to 30 px: a border of a strip crosses every feature somewhere.
      for (const int width_px : {2, 30, 128, 512}) {
        ManyThreads threads;
        const ImageFeatures tiled =
            features::Run({image, {}, {.strip_width_px = width_px, .chunks = 5}}, options, threads);
        EXPECT_TRUE(SameFeatures(tiled, whole)) << width_px << " px, first octave " << first_octave << ", " << choice;
      }
    }
  }
}

TEST(Sift, AllKernelsGiveTheSameBytes) {
  const GreyImage image = Texture(400, 260, 16);
  SerialRunContext context;
  const SelectionRule rule{1 << 20, false, image.width_px, image.height_px};
  const auto detect = [&](const SiftKernels& kernels, int first_octave) {
    return SelectFeatures(
        DetectSift({image}, {first_octave, {0.01, 10}, 4, SiftDescriber(true)}, rule, kernels, context), rule);
  };
  for (const int first_octave : {-1, 0}) {
    const std::vector<Feature> expected = detect(kSiftScalar, first_octave);
    ASSERT_GT(expected.size(), 200U);
    for (const SiftKernels& kernels : AllSiftKernels()) {
      if (!kernels.is_supported) continue;  // by this processor
      const std::vector<Feature> found = detect(kernels, first_octave);
      ASSERT_EQ(found.size(), expected.size()) << kernels.name;
      EXPECT_EQ(std::memcmp(found.data(), expected.data(), found.size() * sizeof(Feature)), 0) << kernels.name;
    }
  }
}

TEST(Sift, SixteenBitImagesKeepTheirDepth) {
  const GreyImage image = Texture(200, 150, 7);
  ASSERT_GT(*std::max_element(image.u8.begin(), image.u8.end()), 127);
  const ImageFeatures expected = Detect(image);
  for (const int factor : {257, 64, 16}) {  // full range, 14 and 12 bits in 16
    GreyImage deep{.width_px = image.width_px, .height_px = image.height_px, .u8 = {}, .u16 = {}, .rgb = {}};
    for (const std::uint8_t v : image.u8) deep.u16.push_back(static_cast<std::uint16_t>(v * factor));
    const ImageFeatures found = Detect(deep);
    std::size_t same = 0;
    for (const Keypoint& k : expected.keypoints) {
      same += static_cast<std::size_t>(std::any_of(found.keypoints.begin(), found.keypoints.end(), [&](const auto& f) {
        return (f.Position() - k.Position()).norm() < 0.03 * k.scale_px && std::abs(f.scale_px / k.scale_px - 1) < 0.01;
      }));
    }
    EXPECT_GE(static_cast<double>(same), 0.95 * static_cast<double>(expected.keypoints.size())) << factor;
  }
  // A ramp of less than one 8-bit level a pixel: eight leading bits would show steps.
  GreyImage faint{.width_px = 120, .height_px = 120, .u8 = {}, .u16 = {}, .rgb = {}};
  for (int y = 0; y < 120; ++y) {
    for (int x = 0; x < 120; ++x)
      faint.u16.push_back(static_cast<std::uint16_t>(
          std::lround(33000 + 900 * std::exp(-(std::pow(x - 60.2, 2) + std::pow(y - 59.7, 2)) / 50) + 60 * x)));
  }
  Options sensitive;
  sensitive.contrast_threshold = 0.002;
  const ImageFeatures found = Detect(faint, sensitive);
  ASSERT_EQ(found.keypoints.empty(), false);
  for (const Keypoint& k : found.keypoints) EXPECT_LT(std::hypot(k.x_px - 60.7, k.y_px - 60.2), 1.0);
}

TEST(Sift, TheStrongestAreKeptAndTheOrderIsTotal) {
  const GreyImage image = Texture(260, 200, 8);
  const ImageFeatures all = Detect(image);
  ASSERT_GT(all.keypoints.size(), 100U);
  for (std::size_t i = 1; i < all.keypoints.size(); ++i) {
    const auto &p = all.keypoints[i - 1], &q = all.keypoints[i];
    EXPECT_LT(std::tie(p.y_px, p.x_px, p.scale_px, p.angle_rad), std::tie(q.y_px, q.x_px, q.scale_px, q.angle_rad));
  }
  std::set<decltype(Values(Keypoint{}))> smaller;
  for (int n = 1; n <= 60; ++n) {
    const ImageFeatures few = Detect(image, OptionsWith(n));
    ASSERT_EQ(few.keypoints.size(), static_cast<std::size_t>(n));
    std::set<decltype(Values(Keypoint{}))> kept;
    float weakest = 1e9F;
    for (const Keypoint& k : few.keypoints) {
      kept.insert(Values(k));
      weakest = std::min(weakest, k.response);
    }
    for (const Keypoint& k : all.keypoints) EXPECT_TRUE(kept.contains(Values(k)) || k.response <= weakest);
    EXPECT_TRUE(std::includes(kept.begin(), kept.end(), smaller.begin(), smaller.end())) << n;
    smaller = kept;
  }
}

TEST(Sift, RootSiftIsTheSquareRootOfTheNormalisedHistogram) {
  const GreyImage image = Texture(160, 120, 9);
  Options raw;
  raw.root_sift = false;
  const ImageFeatures root = Detect(image), plain = Detect(image, raw);
  ASSERT_EQ(root.descriptors.size(), plain.descriptors.size());
  ASSERT_GT(root.descriptors.size(), 20U);
  for (std::size_t i = 0; i < root.descriptors.size(); ++i) {
    double l1 = 0, norm_sq_root = 0, norm_sq_plain = 0;
    for (const int v : plain.descriptors[i]) l1 += v;
    for (std::size_t k = 0; k < 128; ++k) {
      // The plain one is rounded by up to half: the root lies between those of its bounds (and of the sum's, 2 %).
      const double v = plain.descriptors[i][k];
      const double least = 512 * std::sqrt(std::max(0.0, v - 0.5) / (1.02 * l1)),
                   most = 512 * std::sqrt((v + 0.5) / (0.98 * l1));
      EXPECT_GE(root.descriptors[i][k] + 0.5, std::min(255.0, least));
      EXPECT_LE(root.descriptors[i][k] - 0.5, std::min(255.0, most));
      norm_sq_root += std::pow(root.descriptors[i][k], 2);
      norm_sq_plain += std::pow(plain.descriptors[i][k], 2);
    }
    EXPECT_NEAR(std::sqrt(norm_sq_root), 512, 6);
    EXPECT_NEAR(std::sqrt(norm_sq_plain), 512, 8);
  }
}

TEST(Sift, DescriptorsAreThoseOfThePaper) {
  const GreyImage image = Texture(300, 240, 10);
  Options options;
  options.max_features = 400;
  options.root_sift = false;
  const ImageFeatures features = Detect(image, options);
  std::array<testing_support::ReferencePlane, 3> layers;
  int compared = 0, unequal = 0;
  double worst = 1;
  for (int octave = -1; octave <= 0; ++octave) {
    const double surplus = SurplusVariance_px2(octave), step_px = std::exp2(octave);
    for (int layer = 1; layer <= kScales; ++layer)
      layers[static_cast<std::size_t>(layer - 1)] =
          testing_support::AtScale(image, LayerSigma(layer, surplus) * step_px);
    for (std::size_t i = 0; i < features.keypoints.size(); ++i) {
      const Keypoint& k = features.keypoints[i];
      const double nominal_sq = std::pow(k.scale_px / step_px, 2) - surplus;
      const int nearest = static_cast<int>(std::lround(1.5 * std::log2(nominal_sq / (kBaseSigma * kBaseSigma))));
      const double margin_px = 12 * k.scale_px;
      if (!(nominal_sq > 0) || nearest < 1 || nearest > kScales || k.x_px < margin_px || k.y_px < margin_px ||
          k.x_px > image.width_px - margin_px || k.y_px > image.height_px - margin_px)
        continue;
      const auto expected = testing_support::ReferenceDescriptor(layers[static_cast<std::size_t>(nearest - 1)], k.x_px,
                                                                 k.y_px, k.scale_px, k.angle_rad, 16);
      double product = 0, norm_sq = 0;
      for (std::size_t c = 0; c < 128; ++c) {
        product += expected[c] * features.descriptors[i][c];
        norm_sq += std::pow(features.descriptors[i][c], 2);
      }
      const double cosine = product / std::sqrt(norm_sq);
      worst = std::min(worst, cosine);
      unequal += cosine < 0.99 ? 1 : 0;
      ++compared;
    }
  }
  RecordProperty("compared", compared);
  RecordProperty("least_cosine", std::to_string(worst));
  ASSERT_GT(compared, 100);
  // A feature between two octaves may belong to the other one, whose layer is half a step sharper or softer.
  EXPECT_LE(unequal, compared / 50);
  EXPECT_GT(worst, 0.97);
}

TEST(Sift, DirectionsAreThoseOfTheGradient) {
  // A bright blob on a ramp: the ramp's direction is that of the feature.
  for (const double direction_rad : {0.0, 0.4, 1.7, 2.9, -1.2, -2.6}) {
    GreyImage image{.width_px = 101, .height_px = 101, .u8 = {}, .u16 = {}, .rgb = {}};
    for (int y = 0; y < 101; ++y) {
      for (int x = 0; x < 101; ++x) {
        const double along = (x - 50) * std::cos(direction_rad) + (y - 50) * std::sin(direction_rad);
        image.u16.push_back(static_cast<std::uint16_t>(std::lround(
            30000 + 500 * along + 6000 * std::exp(-(std::pow(x - 50, 2) + std::pow(y - 50, 2)) / (2 * 16.0)))));
      }
    }
    const ImageFeatures features = Detect(image);
    ASSERT_FALSE(features.keypoints.empty());
    bool found = false;
    for (const Keypoint& k : features.keypoints) {
      if (std::hypot(k.x_px - 50.5, k.y_px - 50.5) > 2.5 || k.scale_px < 2) continue;
      found = true;
      EXPECT_EQ(k.sign, 1);
      EXPECT_NEAR(std::remainder(k.angle_rad - direction_rad, 2 * std::numbers::pi), 0, 0.05) << direction_rad;
    }
    EXPECT_TRUE(found) << direction_rad;
  }
}

TEST(Sift, BrightnessAndContrastDoNotMatter) {
  const GreyImage image = Texture(260, 200, 17);
  GreyImage dimmed = image;
  for (auto& v : dimmed.u8) v = static_cast<std::uint8_t>(v / 2 + 100);
  Options options, half;
  half.contrast_threshold = 0.5 * options.contrast_threshold;
  const ImageFeatures a = Detect(image, options), b = Detect(dimmed, half);
  ASSERT_GT(a.keypoints.size(), 100U);
  int same = 0;
  for (std::size_t i = 0; i < a.keypoints.size(); ++i) {
    for (std::size_t j = 0; j < b.keypoints.size(); ++j) {
      if ((a.keypoints[i].Position() - b.keypoints[j].Position()).norm() > 0.2) continue;
      if (std::abs(std::remainder(a.keypoints[i].angle_rad - b.keypoints[j].angle_rad, 2 * std::numbers::pi)) > 0.1)
        continue;
      double distance_sq = 0;
      for (std::size_t c = 0; c < 128; ++c)
        distance_sq += std::pow(static_cast<double>(a.descriptors[i][c]) - b.descriptors[j][c], 2);
      if (std::sqrt(distance_sq) < 0.15 * 512) {
        ++same;
        break;
      }
    }
  }
  EXPECT_GT(same, 0.9 * static_cast<double>(a.keypoints.size()));
}

TEST(Sift, PositionCovariancesAreThoseOfRepeatedMeasurement) {
  const std::vector<Blob> blobs = {{40.3, 40.6, 2.0, 60}, {90.8, 40.2, 3.0, 60}, {140.4, 40.4, 4.5, 60}};
  constexpr double kNoise = 4;
  std::vector<double> sum_sq(blobs.size()), predicted(blobs.size());
  std::vector<int> count(blobs.size());
  const GreyImage clean = Render(180, 80, blobs);
  for (int run = 0; run < 300; ++run) {
    GreyImage noisy = clean;
    Rng rng(SeedFor(21, run));
    for (auto& v : noisy.u8)
      v = static_cast<std::uint8_t>(std::clamp(std::lround(v + kNoise * rng.Normal()), 0L, 255L));
    const ImageFeatures features = Detect(noisy);
    for (std::size_t b = 0; b < blobs.size(); ++b) {
      for (const Keypoint& k : features.keypoints) {
        const Eigen::Vector2d off = k.Position() - Eigen::Vector2d(blobs[b].x_px, blobs[b].y_px);
        if (off.norm() > 2 || std::abs(k.scale_px / blobs[b].sigma_px - 1) > 0.4) continue;
        sum_sq[b] += off.squaredNorm();
        predicted[b] += kNoise * kNoise * (static_cast<double>(k.cov_xx_px2) + k.cov_yy_px2);
        ++count[b];
        break;
      }
    }
  }
  for (std::size_t b = 0; b < blobs.size(); ++b) {
    ASSERT_GT(count[b], 250);
    const double ratio = std::sqrt(predicted[b] / sum_sq[b]);
    RecordProperty("predicted_over_empirical_" + std::to_string(b), std::to_string(ratio));
    EXPECT_GT(ratio, 0.8) << b;
    EXPECT_LT(ratio, 1.25) << b;
  }
}

TEST(Sift, MaskedPixelsHaveNoFeatures) {
  const GreyImage image = Texture(260, 200, 18);
  std::vector<std::uint8_t> mask(image.u8.size(), 255);
  for (int y = 0; y < image.height_px; ++y)
    for (int x = 100; x < image.width_px; ++x) mask[static_cast<std::size_t>(y * image.width_px + x)] = 127;
  SerialRunContext context;
  const ImageFeatures all = Detect(image), masked = features::Run({image, mask}, {}, context);
  std::size_t usable = 0;
  for (const Keypoint& k : all.keypoints) usable += k.x_px < 100 ? 1U : 0U;
  ASSERT_GT(usable, 50U);
  EXPECT_EQ(masked.keypoints.size(), usable);
  for (const Keypoint& k : masked.keypoints) EXPECT_LT(k.x_px, 100);
}

TEST(Sift, ColorsAreThePixelsUnderTheKeypoints) {
  GreyImage image = Texture(160, 120, 11);
  const ImageFeatures grey = Detect(image);
  for (int y = 0; y < image.height_px; ++y) {
    for (int x = 0; x < image.width_px; ++x)
      image.rgb.insert(image.rgb.end(), {static_cast<std::uint8_t>(x), static_cast<std::uint8_t>(y), 7});
  }
  const ImageFeatures color = Detect(image);
  ASSERT_EQ(color.colors.size(), color.keypoints.size());
  ASSERT_GT(color.colors.size(), 20U);
  for (std::size_t i = 0; i < color.colors.size(); ++i) {
    const int x = static_cast<int>(color.keypoints[i].x_px), y = static_cast<int>(color.keypoints[i].y_px);
    EXPECT_EQ(color.colors[i], (Rgb{static_cast<std::uint8_t>(x), static_cast<std::uint8_t>(y), 7}));
    const std::uint8_t value = image.u8[static_cast<std::size_t>(y * image.width_px + x)];
    EXPECT_EQ(grey.colors[i], (Rgb{value, value, value}));
  }
}

TEST(Sift, TinyAndTexturelessImagesHaveNoFeatures) {
  EXPECT_TRUE(Detect({}).keypoints.empty());
  for (int side_px = 1; side_px <= 24; ++side_px) {
    const ImageFeatures features = Detect(Texture(side_px, 25 - side_px, 12));
    EXPECT_EQ(features.keypoints.size(), features.descriptors.size());
  }
  EXPECT_TRUE(Detect(Render(5, 400, {{2.5, 200, 1.5, 100}})).keypoints.empty());
  EXPECT_TRUE(Detect(Render(300, 200, {})).keypoints.empty());
}

TEST(Sift, AStopRequestEndsIt) {
  class Stopped : public SerialRunContext {
    bool StopRequested() const override { return true; }
  } context;
  EXPECT_THROW(features::Run({Texture(64, 64, 13)}, {}, context), Cancelled);
}

TEST(Sift, TheEstimateIsATightUpperBoundOfTheMemory) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer's own memory would be measured";
#endif
  constexpr int kWidth_px = 4000, kHeight_px = 3000;
  int pipe_ends[2];
  ASSERT_EQ(pipe(pipe_ends), 0);
  const pid_t child = fork();
  if (child == 0) {  // a process of its own, because the high-water mark never falls
    malloc_trim(0);
    rusage before{}, after{};
    getrusage(RUSAGE_SELF, &before);
    {
      GreyImage image{.width_px = kWidth_px, .height_px = kHeight_px, .u8 = {}, .u16 = {}, .rgb = {}};
      Rng rng(14);  // noise: more keypoints before the cut than any photograph has
      for (int i = 0; i < kWidth_px * kHeight_px; ++i) image.u8.push_back(static_cast<std::uint8_t>(rng.Below(256)));
      image.rgb.assign(image.u8.size() * 3, 1);
      Detect(image, OptionsWith(2000));
    }
    getrusage(RUSAGE_SELF, &after);
    const long grown_kib = after.ru_maxrss - before.ru_maxrss;
    _exit(write(pipe_ends[1], &grown_kib, sizeof grown_kib) == sizeof grown_kib ? 0 : 1);
  }
  long grown_kib = 0;
  ASSERT_EQ(read(pipe_ends[0], &grown_kib, sizeof grown_kib), static_cast<ssize_t>(sizeof grown_kib));
  int status = 1;
  waitpid(child, &status, 0);
  ASSERT_EQ(status, 0);
  const double ratio = static_cast<double>(Estimate(kWidth_px, kHeight_px, 8, OptionsWith(2000), {}).peak_bytes) /
                       (1024.0 * static_cast<double>(grown_kib));
  RecordProperty("estimate_over_measured", std::to_string(ratio));
  EXPECT_GE(ratio, 1.0);
  EXPECT_LE(ratio, 1.5);
}

}  // namespace
}  // namespace rilievo::features
