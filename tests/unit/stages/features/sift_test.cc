// SIFT: positions in the pixel frame, the cut, RootSIFT against its definition, memory against the estimate.
#include "stages/features/sift.h"

#include <gtest/gtest.h>
#include <malloc.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <set>
#include <tuple>

#include "base/rng.h"

namespace rilievo::features {
namespace {

struct Blob {
  double x_px, y_px, sigma_px, height;
};

/// Sum of Gaussian blobs on mid grey, sampled at pixel centres (first centre (0.5, 0.5)).
GreyImage Render(int width_px, int height_px, const std::vector<Blob>& blobs) {
  std::vector<double> grey(static_cast<std::size_t>(width_px * height_px), 110.0);
  for (const Blob& blob : blobs) {
    const int reach = static_cast<int>(std::ceil(5 * blob.sigma_px));
    const int cx = static_cast<int>(blob.x_px), cy = static_cast<int>(blob.y_px);
    for (int y = std::max(0, cy - reach); y <= std::min(height_px - 1, cy + reach); ++y) {
      for (int x = std::max(0, cx - reach); x <= std::min(width_px - 1, cx + reach); ++x) {
        const double r_sq = std::pow(x + 0.5 - blob.x_px, 2) + std::pow(y + 0.5 - blob.y_px, 2);
        grey[static_cast<std::size_t>(y * width_px + x)] +=
            blob.height * std::exp(-r_sq / (2 * blob.sigma_px * blob.sigma_px));
      }
    }
  }
  GreyImage image{.width_px = width_px, .height_px = height_px, .u8 = {}, .u16 = {}, .rgb = {}};
  for (const double g : grey) image.u8.push_back(static_cast<std::uint8_t>(std::clamp(std::round(g), 0.0, 255.0)));
  return image;
}

GreyImage Texture(int width_px, int height_px, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<Blob> blobs;
  for (int i = 0; i < width_px * height_px / 60; ++i) {
    blobs.push_back(
        {rng.Uniform(0, width_px), rng.Uniform(0, height_px), std::exp(rng.Uniform(0.0, 1.8)), rng.Uniform(-60, 60)});
  }
  return Render(width_px, height_px, blobs);
}

ImageFeatures Detect(const GreyImage& image, const Options& options = {}, std::span<const std::uint8_t> mask = {}) {
  SerialRunContext context;
  return Run({image, mask}, options, context);
}

auto Values(const Keypoint& k) { return std::make_tuple(k.y_px, k.x_px, k.scale_px, k.angle_rad, k.response); }

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
  GreyImage turned{.width_px = image.height_px, .height_px = image.width_px, .u8 = image.u8, .u16 = {}, .rgb = {}};
  for (int y = 0; y < image.height_px; ++y) {
    for (int x = 0; x < image.width_px; ++x) {  // (x, y) -> (H - y, x): +x becomes +y
      turned.u8[static_cast<std::size_t>(x * turned.width_px + image.height_px - 1 - y)] =
          image.u8[static_cast<std::size_t>(y * image.width_px + x)];
    }
  }
  const ImageFeatures before = Detect(image), after = Detect(turned);
  ASSERT_GT(before.keypoints.size(), 100U);
  int found = 0;
  Eigen::Vector2d sum(0, 0);
  for (const Keypoint& k : before.keypoints) {
    const Eigen::Vector2d expected(image.height_px - k.y_px, k.x_px);
    for (const Keypoint& t : after.keypoints) {
      const double turn = std::remainder(t.angle_rad - k.angle_rad - std::numbers::pi / 2, 2 * std::numbers::pi);
      if ((t.Position() - expected).norm() > 0.3 || std::abs(turn) > 0.1 || std::abs(t.scale_px / k.scale_px - 1) > 0.1)
        continue;
      ++found;
      sum += t.Position() - expected;
      break;
    }
  }
  EXPECT_GT(found, 0.85 * static_cast<double>(before.keypoints.size()));
  EXPECT_LT((sum / found).norm(), 0.02);
}

TEST(Sift, ResultsDoNotDependOnTheThreadsOfTheLibrary) {
  const GreyImage image = Texture(500, 400, 6);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const ImageFeatures one = Detect(image);
  cv::setNumThreads(2);
  const ImageFeatures two = Detect(image);
  cv::setNumThreads(threads);
  ASSERT_FALSE(one.keypoints.empty());
  EXPECT_TRUE(SameFeatures(one, two));
}

TEST(Sift, SixteenBitImagesGiveWhatTheirEightLeadingBitsGive) {
  const GreyImage image = Texture(200, 150, 7);
  ASSERT_GT(*std::max_element(image.u8.begin(), image.u8.end()), 127);
  const ImageFeatures expected = Detect(image);
  for (const int factor : {257, 64, 16, 1}) {  // full range, 14, 12 and 8 bits in 16
    GreyImage deep{.width_px = image.width_px, .height_px = image.height_px, .u8 = {}, .u16 = {}, .rgb = {}};
    for (const std::uint8_t v : image.u8) deep.u16.push_back(static_cast<std::uint16_t>(v * factor));
    EXPECT_TRUE(SameFeatures(Detect(deep), expected)) << factor;
  }
}

TEST(Sift, TheStrongestAreKeptAndTheOrderIsTotal) {
  const GreyImage image = Texture(260, 200, 8);
  const ImageFeatures all = Detect(image);
  ASSERT_GT(all.keypoints.size(), 100U);
  for (std::size_t i = 1; i < all.keypoints.size(); ++i) {
    const auto &p = all.keypoints[i - 1], &q = all.keypoints[i];
    EXPECT_LT(std::tie(p.y_px, p.x_px, p.scale_px, p.angle_rad), std::tie(q.y_px, q.x_px, q.scale_px, q.angle_rad));
  }
  std::set<std::tuple<float, float, float, float, float>> smaller;
  for (int n = 1; n <= 60; ++n) {
    const ImageFeatures few = Detect(image, {.max_features = n});
    ASSERT_EQ(few.keypoints.size(), static_cast<std::size_t>(n));
    std::set<std::tuple<float, float, float, float, float>> kept;
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
  const ImageFeatures root = Detect(image), plain = Detect(image, {.root_sift = false});
  ASSERT_EQ(root.descriptors.size(), plain.descriptors.size());
  ASSERT_GT(root.descriptors.size(), 20U);
  for (std::size_t i = 0; i < root.descriptors.size(); ++i) {
    double l1 = 0, norm_sq_root = 0, norm_sq_plain = 0;
    for (const int v : plain.descriptors[i]) l1 += v;
    for (std::size_t k = 0; k < 128; ++k) {
      const double x = std::min(255.0, 512 * std::sqrt(plain.descriptors[i][k] / l1));
      EXPECT_NEAR(root.descriptors[i][k], x, 0.5 + 1e-9);
      norm_sq_root += std::pow(root.descriptors[i][k], 2);
      norm_sq_plain += std::pow(plain.descriptors[i][k], 2);
    }
    EXPECT_NEAR(std::sqrt(norm_sq_root), 512, 6);
    EXPECT_NEAR(std::sqrt(norm_sq_plain), 512, 8);
  }
}

TEST(Sift, DescriptorsBelongToTheirKeypoints) {
  const GreyImage image = Texture(260, 200, 10);
  std::vector<cv::KeyPoint> keypoints;
  cv::Mat descriptors;
  cv::Mat mat(image.height_px, image.width_px, CV_8UC1, const_cast<std::uint8_t*>(image.u8.data()));
  cv::SIFT::create(0, 3, 0.02, 10, 1.6)->detectAndCompute(mat, cv::noArray(), keypoints, descriptors);
  const ImageFeatures features = Detect(image, {.max_features = 50, .root_sift = false});
  int found = 0;
  for (std::size_t i = 0; i < features.keypoints.size(); ++i) {
    const Keypoint& k = features.keypoints[i];
    for (std::size_t j = 0; j < keypoints.size(); ++j) {
      if (std::hypot(keypoints[j].pt.x + 0.25 - k.x_px, keypoints[j].pt.y + 0.25 - k.y_px) > 1e-4) continue;
      if (std::abs(std::remainder(keypoints[j].angle - k.angle_rad * 180 / std::numbers::pi, 360)) > 1e-3) continue;
      ++found;
      for (int c = 0; c < 128; ++c)
        EXPECT_EQ(features.descriptors[i][static_cast<std::size_t>(c)], descriptors.at<float>(static_cast<int>(j), c));
    }
  }
  EXPECT_EQ(found, 50);
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

TEST(Sift, AMaskKeepsTheFeaturesOnItBeforeTheCut) {
  const GreyImage image = Texture(300, 200, 21);
  Rng rng(22);
  std::vector<std::uint8_t> mask(300 * 200);
  for (std::size_t i = 0; i < mask.size(); ++i)  // squares of 20 px
    mask[i] = Mix64(i % 300 / 20 + 100 * (i / 300 / 20)) % 2 == 0 ? static_cast<std::uint8_t>(128 + rng.Below(128))
                                                                  : static_cast<std::uint8_t>(rng.Below(128));
  const ImageFeatures every = Detect(image), masked = Detect(image, {}, mask);
  ImageFeatures expected;
  for (std::size_t i = 0; i < every.keypoints.size(); ++i) {
    const auto pixel =
        static_cast<std::size_t>(every.keypoints[i].y_px) * 300 + static_cast<std::size_t>(every.keypoints[i].x_px);
    if (mask[pixel] < 128) continue;
    expected.keypoints.push_back(every.keypoints[i]);
    expected.descriptors.push_back(every.descriptors[i]);
    expected.colors.push_back(every.colors[i]);
  }
  ASSERT_GT(expected.keypoints.size(), 50U);
  ASSERT_LT(expected.keypoints.size(), every.keypoints.size());
  EXPECT_TRUE(SameFeatures(masked, expected));
  Options few;
  few.max_features = 40;
  std::vector<float> strongest;
  for (const Keypoint& k : expected.keypoints) strongest.push_back(k.response);
  std::sort(strongest.rbegin(), strongest.rend());
  const ImageFeatures cut = Detect(image, few, mask);
  ASSERT_EQ(cut.keypoints.size(), 40U);
  for (const Keypoint& k : cut.keypoints) EXPECT_GE(k.response, strongest[39]);
  EXPECT_TRUE(SameFeatures(Detect(image, {}, std::vector<std::uint8_t>(mask.size(), 255)), every));
  EXPECT_TRUE(Detect(image, {}, std::vector<std::uint8_t>(mask.size(), 127)).keypoints.empty());
}

TEST(Sift, AStopRequestEndsIt) {
  class Stopped : public SerialRunContext {
    bool StopRequested() const override { return true; }
  } context;
  EXPECT_THROW(features::Run({Texture(64, 64, 13), {}}, {}, context), Cancelled);
}

TEST(Sift, TheEstimateIsATightUpperBoundOfTheMemory) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer's own memory would be measured";
#endif
  EXPECT_LT(static_cast<double>(Estimate(4240, 2832, {}).peak_bytes),
            2.9 * 1073741824.0);  // 12 Mpx in a budget of 4 GiB
  constexpr int kWidth_px = 1800, kHeight_px = 1400;
  int pipe_ends[2];
  ASSERT_EQ(pipe(pipe_ends), 0);
  const pid_t child = fork();
  if (child == 0) {  // a process of its own, because the high-water mark never falls
    cv::setNumThreads(1);
    malloc_trim(0);
    rusage before{}, after{};
    getrusage(RUSAGE_SELF, &before);
    {
      GreyImage image{.width_px = kWidth_px, .height_px = kHeight_px, .u8 = {}, .u16 = {}, .rgb = {}};
      Rng rng(14);  // noise: more keypoints before the cut than any photograph has
      for (int i = 0; i < kWidth_px * kHeight_px; ++i) image.u8.push_back(static_cast<std::uint8_t>(rng.Below(256)));
      image.rgb.assign(image.u8.size() * 3, 1);
      Detect(image);
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
  const double ratio =
      static_cast<double>(Estimate(kWidth_px, kHeight_px, {}).peak_bytes) / (1024.0 * static_cast<double>(grown_kib));
  RecordProperty("estimate_over_measured", std::to_string(ratio));
  EXPECT_GE(ratio, 1.0);
  EXPECT_LE(ratio, 1.15);
}

}  // namespace
}  // namespace rilievo::features
