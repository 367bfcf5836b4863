// FAST against a plain segment test of every pixel and OpenCV's; thresholds of cells; any tiling, any kernel.
#include "stages/features/fast.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <climits>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <set>

#include "base/rng.h"
#include "stages/features/fast_kernels.h"
#include "tests/support/blob_image.h"

namespace rilievo::features {
namespace {

using testing_support::BlobTexture;
using testing_support::Deepen;
using testing_support::QuarterTurn;

/// Bright and dark polygons with noise: real corners beside the blobs.
GreyImage Corners(int width_px, int height_px, std::uint64_t seed) {
  GreyImage image = BlobTexture(width_px, height_px, seed);
  Rng rng(seed + 1);
  for (int i = 0; i < width_px * height_px / 400; ++i) {
    const int x = static_cast<int>(rng.Below(static_cast<std::uint32_t>(width_px))),
              y = static_cast<int>(rng.Below(static_cast<std::uint32_t>(height_px)));
    const int w = 3 + static_cast<int>(rng.Below(12)), h = 3 + static_cast<int>(rng.Below(12));
    const auto value = static_cast<std::uint8_t>(rng.Below(256));
    for (int r = y; r < std::min(y + h, height_px); ++r) {
      for (int c = x; c < std::min(x + w - (r - y) / 2, width_px); ++c)
        image.u8[static_cast<std::size_t>(r * width_px + c)] = value;
    }
  }
  return image;
}

std::vector<Corner> Detect(const GreyImage& image, const FastOptions& options = {}, const Tiling& tiling = {},
                           std::span<const std::uint8_t> mask = {}) {
  SerialRunContext context;
  return DetectFast({.image = image, .mask = mask}, options, tiling, context);
}

int PixelOf(const GreyImage& image, int x, int y) {
  const auto i = static_cast<std::size_t>(y * image.width_px + x);
  return image.Is16Bit() ? image.u16[i] : image.u8[i];
}

/// The segment test as the paper words it.
bool IsCorner(const GreyImage& image, int x, int y, int arc, int threshold) {
  const int circle[16][2] = {{0, -3}, {1, -3}, {2, -2}, {3, -1}, {3, 0},  {3, 1},   {2, 2},   {1, 3},
                             {0, 3},  {-1, 3}, {-2, 2}, {-3, 1}, {-3, 0}, {-3, -1}, {-2, -2}, {-1, -3}};
  if (x < 3 || y < 3 || x >= image.width_px - 3 || y >= image.height_px - 3) return false;
  const int center = PixelOf(image, x, y);
  int brighter = 0, darker = 0;
  for (int i = 0; i < 16 + arc; ++i) {
    const int value = PixelOf(image, x + circle[i % 16][0], y + circle[i % 16][1]);
    brighter = value > center + threshold ? brighter + 1 : 0;
    darker = value < center - threshold ? darker + 1 : 0;
    if (brighter >= arc || darker >= arc) return true;
  }
  return false;
}

/// Largest threshold at which (x, y) is a corner, by bisection; -1 if none.
int Score(const GreyImage& image, int x, int y, int arc) {
  int low = -1, high = 65536;
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    (IsCorner(image, x, y, arc, middle) ? low : high) = middle;
  }
  return low;
}

double Roundness(const GreyImage& image, int x, int y, int window) {
  double n[3] = {};
  for (int j = y - window / 2; j <= y + window / 2; ++j) {
    for (int i = x - window / 2; i <= x + window / 2; ++i) {
      const double gx = PixelOf(image, i + 1, j) - PixelOf(image, i - 1, j);
      const double gy = PixelOf(image, i, j + 1) - PixelOf(image, i, j - 1);
      n[0] += gx * gx, n[1] += gx * gy, n[2] += gy * gy;
    }
  }
  return n[0] + n[2] == 0 ? 0 : 4 * (n[0] * n[2] - n[1] * n[1]) / std::pow(n[0] + n[2], 2);
}

std::vector<Corner> BruteForce(const GreyImage& image, const FastOptions& options, double unit) {
  const int w = image.width_px, h = image.height_px;
  std::vector<int> scores;
  for (int i = 0; i < w * h; ++i) {
    const int score = Score(image, i % w, i / w, options.arc);
    scores.push_back(score * unit >= options.min_threshold ? score : -1);
  }
  std::vector<Corner> all;
  const int border = options.roundness_window_px / 2 + 1;
  for (int y = border; y < h - border; ++y) {
    for (int x = border; x < w - border; ++x) {
      const int score = scores[static_cast<std::size_t>(y * w + x)];
      bool is_largest = score >= 0;
      for (int k = 0; k < 9 && is_largest; ++k) {
        const int other = scores[static_cast<std::size_t>((y + k / 3 - 1) * w + x + k % 3 - 1)];
        is_largest = k == 4 || (k < 4 ? other < score : other <= score);
      }
      const double q = is_largest ? Roundness(image, x, y, options.roundness_window_px) : -1;
      if (q < options.min_roundness) continue;
      all.push_back({static_cast<float>(x) + 0.5F, static_cast<float>(y) + 0.5F, static_cast<float>(score * unit),
                     static_cast<float>(q)});
    }
  }
  // The largest threshold of each cell that leaves it its share.
  std::vector<Corner> kept;
  for (const Corner& c : all) {
    const int left = static_cast<int>(c.x_px) / 64 * 64, top = static_cast<int>(c.y_px) / 64 * 64;
    const double area = std::min(64, w - left) * std::min(64, h - top);
    const auto share = std::ceil(options.corners * area / (w * h) - 1e-9);
    const auto stronger = std::count_if(all.begin(), all.end(), [&](const Corner& o) {
      return static_cast<int>(o.x_px) / 64 * 64 == left && static_cast<int>(o.y_px) / 64 * 64 == top &&
             o.score > c.score;
    });
    if (static_cast<double>(stronger) < share) kept.push_back(c);
  }
  return kept;
}

class FastArc : public testing::TestWithParam<int> {};

TEST_P(FastArc, FindsWhatThePlainSegmentTestFinds) {
  const GreyImage image = Corners(203, 171, 1);
  FastOptions options{.arc = GetParam(), .corners = 200};
  const auto found = Detect(image, options);
  EXPECT_EQ(found, BruteForce(image, options, 1));
  EXPECT_GT(found.size(), 60U);
  options = {.arc = GetParam(), .corners = INT_MAX, .min_threshold = 0, .min_roundness = 0, .roundness_window_px = 3};
  EXPECT_EQ(Detect(image, options), BruteForce(image, options, 1));
}

TEST_P(FastArc, SixteenBits) {
  const GreyImage grey = Corners(150, 131, 2);
  GreyImage image = Deepen(grey, 100);  // 15 bits: all of them are kept
  Rng rng(3);
  for (auto& v : image.u16) v = static_cast<std::uint16_t>(v + rng.Below(100));
  const FastOptions options{.arc = GetParam(), .corners = 150};
  const auto found = Detect(image, options);
  EXPECT_EQ(found, BruteForce(image, options, 1.0 / 128));
  EXPECT_GT(found.size(), 40U);
  EXPECT_EQ(Detect(grey, options), Detect(Deepen(grey, 1), options));
  EXPECT_EQ(Detect(grey, options).size(), Detect(Deepen(grey, 128), options).size());
  EXPECT_FALSE(Detect(Deepen(grey, 257), options).empty());  // white is 65535
}

/// OpenCV's list of all pixels that pass the test at a threshold, before non-maximum suppression.
TEST_P(FastArc, ScoresAgreeWithOpenCv) {
  const int arc = GetParam();
  GreyImage image = Corners(160, 140, 4);
  const cv::Mat mat(image.height_px, image.width_px, CV_8UC1, image.u8.data());
  for (const int threshold : {1, 10, 40}) {
    std::vector<cv::KeyPoint> keypoints;
    // OpenCV has 9 of 16; there is no 12 of 16 in it, whose corners are a subset.
    cv::FAST(mat, keypoints, threshold, false, cv::FastFeatureDetector::TYPE_9_16);
    std::set<std::pair<int, int>> theirs, ours;
    for (const auto& k : keypoints) theirs.emplace(static_cast<int>(k.pt.y), static_cast<int>(k.pt.x));
    std::vector<std::int16_t> pixels(image.u8.begin(), image.u8.end()), scores(512, 0);
    pixels.resize(pixels.size() + 512, 0);
    for (int y = 3; y < image.height_px - 3; ++y) {
      fast::ScoreRow row{};
      for (int j = 0; j < 7; ++j) row.rows[j] = pixels.data() + (y + j - 3) * image.width_px + 3;
      row.count = image.width_px - 6;
      row.arc = arc;
      row.out = scores.data();
      ChooseFastKernels("").scores(row);
      for (int x = 0; x < row.count; ++x) {
        if (scores[static_cast<std::size_t>(x)] > threshold) ours.emplace(y, x + 3);
      }
    }
    if (arc == 9) {
      EXPECT_EQ(ours, theirs) << threshold;
    } else {
      EXPECT_TRUE(std::includes(theirs.begin(), theirs.end(), ours.begin(), ours.end()));
    }
    EXPECT_GT(ours.size(), 50U);
  }
}

TEST_P(FastArc, AnyTilingAndKernelGivesTheSameBytes) {
  const GreyImage grey = Corners(601, 333, 5);
  SerialRunContext context;
  for (const GreyImage& image : {grey, Deepen(grey, 77), Deepen(grey, 257)}) {
    const FastOptions options{.arc = GetParam()};
    const auto expected = DetectFast({.image = image}, options, {1 << 20, 1}, context, ChooseFastKernels("scalar"));
    EXPECT_GT(expected.size(), 300U);
    for (const int strip_px : {1, 64, 100, 200, 512, 4096}) {
      for (const int chunks : {1, 3, 16}) EXPECT_EQ(expected, Detect(image, options, {strip_px, chunks})) << strip_px;
    }
    for (const FastKernels& kernels : AllFastKernels()) {
      if (!kernels.is_supported) continue;
      EXPECT_EQ(expected, DetectFast({.image = image}, options, {}, context, kernels)) << kernels.name;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Both, FastArc, testing::Values(9, 12));

TEST(Fast, EveryCellGetsItsShareHoweverWeakItsTexture) {
  GreyImage image = Corners(512, 256, 6);
  for (int y = 0; y < 256; ++y) {  // the left half has an eighth of the contrast
    for (int x = 0; x < 256; ++x) {
      auto& v = image.u8[static_cast<std::size_t>(y * 512 + x)];
      v = static_cast<std::uint8_t>(110 + v / 8);
    }
  }
  std::vector<int> counts(32, 0);
  for (const Corner& c : Detect(image, {.corners = 320, .min_threshold = 1}))
    ++counts[static_cast<std::size_t>(static_cast<int>(c.y_px) / 64 * 8 + static_cast<int>(c.x_px) / 64)];
  for (const int count : counts) {
    EXPECT_GE(count, 7);
    EXPECT_LE(count, 20);  // equal scores stay together
  }
}

TEST(Fast, EdgesAreNotRound) {
  GreyImage image = BlobTexture(128, 128, 7);
  for (int y = 0; y < 128; ++y) {
    for (int x = 0; x < 128; ++x)  // an edge with a tooth of one pixel here and there, which FAST takes for corners
      image.u8[static_cast<std::size_t>(y * 128 + x)] = x < (y % 9 == 0 ? 65 : 64) ? 40 : 200;
  }
  EXPECT_FALSE(Detect(image, {.min_roundness = 0}).empty());
  EXPECT_TRUE(Detect(image).empty());
}

TEST(Fast, AQuarterTurnTurnsCorners) {
  const GreyImage image = Corners(256, 192, 8);
  const FastOptions all{.corners = INT_MAX};
  const auto corners = Detect(image, all), turned = Detect(QuarterTurn(image), all);
  std::size_t repeated = 0;
  for (const Corner& c : corners) {
    repeated += std::any_of(turned.begin(), turned.end(), [&](const Corner& t) {
      // Of neighbours with equal scores another one may win, and then be less round.
      return t.score == c.score && std::abs(t.x_px - (192 - c.y_px)) <= 1 && std::abs(t.y_px - c.x_px) <= 1;
    });
  }
  EXPECT_GT(corners.size(), 500U);
  EXPECT_GT(static_cast<double>(repeated), 0.9 * static_cast<double>(corners.size()));
}

TEST(Fast, MaskedPixelsHaveNoCornersAndTakeNoShare) {
  const GreyImage image = Corners(192, 128, 9);
  std::vector<std::uint8_t> mask(image.u8.size(), 255);
  for (std::size_t i = 0; i < mask.size(); ++i) mask[i] = i % 192 % 64 < 32 ? 127 : 128;
  const auto corners = Detect(image, {.corners = 60}, {}, mask);
  EXPECT_GE(corners.size(), 50U);
  for (const Corner& c : corners) EXPECT_GE(static_cast<int>(c.x_px) % 64, 32);
}

TEST(Fast, TinyBlackAndFlatImagesHaveNoCorners) {
  EXPECT_TRUE(Detect({}).empty());
  for (const auto& [w, h] : {std::pair{1, 1}, {1, 300}, {300, 1}, {6, 6}, {7, 7}, {8, 3}})
    EXPECT_TRUE(Detect(Corners(w, h, 10), {.min_threshold = 0, .min_roundness = 0}).empty());
  for (int side_px = 9; side_px < 30; ++side_px) {
    const FastOptions options{.corners = INT_MAX, .min_threshold = 0, .min_roundness = 0};
    const GreyImage image = Corners(side_px, 40 - side_px, 11);
    EXPECT_EQ(Detect(image, options), BruteForce(image, options, 1)) << side_px;
  }
  GreyImage black = BlobTexture(100, 80, 12);
  std::fill(black.u8.begin(), black.u8.end(), std::uint8_t{0});
  EXPECT_TRUE(Detect(black, {.min_threshold = 0, .min_roundness = 0}).empty());
  EXPECT_TRUE(Detect(Deepen(black, 1), {.min_threshold = 0, .min_roundness = 0}).empty());
}

TEST(Fast, AStopRequestEndsIt) {
  class Stopped : public SerialRunContext {
    bool StopRequested() const override { return true; }
  } context;
  const GreyImage image = Corners(64, 64, 13);
  EXPECT_THROW(DetectFast({.image = image}, {}, {}, context), Cancelled);
}

}  // namespace
}  // namespace rilievo::features
