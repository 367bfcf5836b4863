// SURF against a plain reference, truth of synthetic blobs, invariances; the same bytes for any tiling and kernel.
#include "stages/features/surf.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <string>
#include <tuple>

#include "base/error.h"
#include "base/rng.h"
#include "stages/features/surf_geometry.h"
#include "stages/features/surf_kernels.h"
#include "tests/support/blob_image.h"
#include "tests/support/surf_reference.h"

namespace rilievo::features {
namespace {

using testing_support::Blob;
using testing_support::BlobTexture;
using testing_support::Deepen;
using testing_support::QuarterTurn;
using testing_support::RenderBlobs;
using testing_support::SmoothSixteenfold;
using testing_support::SurfReference;

auto Values(const Feature& f) {
  const Keypoint& k = f.keypoint;
  return std::make_tuple(k.y_px, k.x_px, k.scale_px, k.angle_rad, k.response, k.sign, f.descriptor);
}

std::vector<Feature> Sorted(std::vector<Feature> features) {
  std::sort(features.begin(), features.end(), [](const Feature& a, const Feature& b) { return Values(a) < Values(b); });
  return features;
}

std::vector<Feature> Detect(const GreyImage& image, const SurfOptions& options = {}, const Tiling& tiling = {}) {
  SerialRunContext context;
  return Sorted(DetectSurf({.image = image}, options, tiling, context));
}

bool AreSame(const std::vector<Feature>& a, const std::vector<Feature>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const Feature& p, const Feature& q) { return Values(p) == Values(q); });
}

double Distance(const Descriptor& a, const Descriptor& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += std::pow(a[i] - b[i], 2);
  return std::sqrt(sum);
}

double AngleBetween(double a, double b) { return std::abs(std::remainder(a - b, 2 * std::numbers::pi)); }

TEST(Surf, FindsWhatAPlainSearchFinds) {
  const double threshold = 4;
  const GreyImage image = BlobTexture(301, 263, 1), smooth = SmoothSixteenfold(image);
  auto expected = SurfReference(smooth, 1.0 / 16).Detect(threshold);
  std::sort(expected.begin(), expected.end(), [](const Keypoint& a, const Keypoint& b) {
    return std::tie(a.y_px, a.x_px, a.scale_px) < std::tie(b.y_px, b.x_px, b.scale_px);
  });
  for (const GreyImage& variant : {image, Deepen(image, 4)}) {  // 8 and 10 bits
    const auto found = Detect(variant, {.hessian_threshold = threshold, .upright = true});
    ASSERT_EQ(found.size(), expected.size());
    EXPECT_GT(found.size(), 100U);
    for (std::size_t i = 0; i < found.size(); ++i) {
      const Keypoint& k = found[i].keypoint;
      ASSERT_NEAR(k.x_px, expected[i].x_px, 2e-2);
      ASSERT_NEAR(k.y_px, expected[i].y_px, 2e-2);
      ASSERT_NEAR(k.scale_px, expected[i].scale_px, 2e-2);
      ASSERT_NEAR(k.response, expected[i].response, 1e-4 * expected[i].response);
      ASSERT_EQ(k.sign, expected[i].sign);
    }
  }
}

class SurfElements : public testing::TestWithParam<int> {};

TEST_P(SurfElements, DescriptorsAndAnglesFollowThePaper) {
  const int elements = GetParam();
  const GreyImage image = BlobTexture(241, 230, 2), smooth = SmoothSixteenfold(image);
  const SurfReference reference(smooth);
  for (const bool upright : {false, true}) {
    const auto features = Detect(image, {.elements = elements, .upright = upright});
    ASSERT_GT(features.size(), 80U);
    std::size_t angles = 0, descriptors = 0;
    for (const Feature& f : features) {
      // A sample exactly between two pixels or two bins may fall to the other side in single precision.
      const double angle = upright ? 0 : reference.Orientation(f.keypoint);
      angles += AngleBetween(angle, f.keypoint.angle_rad) < 1e-3 ? 1U : 0U;
      const auto expected = reference.Describe(f.keypoint, elements);
      double largest = 0;
      for (std::size_t i = 0; i < expected.size(); ++i) {
        largest = std::max(largest, std::abs(f.descriptor[i] - std::clamp(128 + 256 * expected[i], 0.0, 255.0)));
      }
      descriptors += largest <= 0.51 ? 1U : 0U;
      EXPECT_LE(largest, 6) << upright;
      for (std::size_t i = expected.size(); i < 128; ++i) ASSERT_EQ(f.descriptor[i], 128);
    }
    EXPECT_GE(static_cast<double>(angles), 0.98 * static_cast<double>(features.size()));
    EXPECT_GE(static_cast<double>(descriptors), 0.95 * static_cast<double>(features.size()));
  }
}

INSTANTIATE_TEST_SUITE_P(Both, SurfElements, testing::Values(64, 128));

class SurfBlobs : public testing::TestWithParam<double> {};

TEST_P(SurfBlobs, PositionsAreUnbiasedScalesFollowAndSignsTellBrightFromDark) {
  const double sigma_px = GetParam();
  const int pitch_px = static_cast<int>(std::ceil(14 * sigma_px)), margin_px = 110;
  Rng rng(3);
  std::vector<Blob> blobs;
  for (int i = 0; i < 64; ++i) {
    blobs.push_back({margin_px + pitch_px * (i % 8 + 0.5) + rng.Uniform(0, 8),
                     margin_px + pitch_px * (i / 8 + 0.5) + rng.Uniform(0, 8), sigma_px, i % 2 == 0 ? 100.0 : -100.0});
  }
  const int side_px = 2 * margin_px + 8 * pitch_px + 8;
  const auto features = Detect(RenderBlobs(side_px, side_px, blobs), {.hessian_threshold = 20});
  double sum_x = 0, sum_y = 0, sum_scale = 0, worst = 0;
  for (const Blob& blob : blobs) {
    const Feature* nearest = nullptr;
    double best = 1e9;
    for (const Feature& f : features) {
      const double distance = std::hypot(f.keypoint.x_px - blob.x_px, f.keypoint.y_px - blob.y_px);
      if (distance < best) best = distance, nearest = &f;
    }
    ASSERT_NE(nearest, nullptr);
    EXPECT_EQ(nearest->keypoint.sign, blob.height > 0 ? 1 : -1);
    worst = std::max(worst, best);
    sum_x += nearest->keypoint.x_px - blob.x_px;
    sum_y += nearest->keypoint.y_px - blob.y_px;
    sum_scale += nearest->keypoint.scale_px;
  }
  RecordProperty("worst_px", std::to_string(worst));
  EXPECT_LT(std::abs(sum_x / 64), 0.02);
  EXPECT_LT(std::abs(sum_y / 64), 0.02);
  EXPECT_LT(worst, 0.15 * sigma_px);
  EXPECT_NEAR(sum_scale / 64 / sigma_px, 1.0, 0.3);
}

INSTANTIATE_TEST_SUITE_P(Sigmas, SurfBlobs, testing::Values(2.2, 2.5, 4.0, 6.0, 10.0));

/// Share of a's features that reappear in b: place, scale and angle mapped by the caller, and the descriptor beside.
template <class Map>
double Repeated(const std::vector<Feature>& a, const std::vector<Feature>& b, double tolerance_px, double tolerance_rad,
                double largest_distance, const Map& map) {
  std::size_t repeated = 0;
  for (const Feature& f : a) {
    const Keypoint k = map(f.keypoint);
    repeated += std::any_of(b.begin(), b.end(), [&](const Feature& g) {
      return std::hypot(g.keypoint.x_px - k.x_px, g.keypoint.y_px - k.y_px) < tolerance_px &&
             std::abs(std::log(g.keypoint.scale_px / k.scale_px)) < 0.2 && g.keypoint.sign == k.sign &&
             AngleBetween(g.keypoint.angle_rad, k.angle_rad) < tolerance_rad &&
             Distance(g.descriptor, f.descriptor) < largest_distance;
    });
  }
  return static_cast<double>(repeated) / static_cast<double>(a.size());
}

TEST(Surf, AQuarterTurnTurnsFeatures) {
  // Sides of 8 n + 1: the samples of all octaves fall on each other.
  const GreyImage image = BlobTexture(321, 257, 4);
  const auto features = Detect(image), turned = Detect(QuarterTurn(image));
  ASSERT_GT(features.size(), 150U);
  EXPECT_EQ(features.size(), turned.size());
  const auto turn = [&](Keypoint k) {
    const float x = k.x_px;
    k.x_px = 257 - k.y_px;
    k.y_px = x;
    k.angle_rad += static_cast<float>(std::numbers::pi / 2);
    return k;
  };
  EXPECT_EQ(Repeated(features, turned, 1e-3, 10, 1000, turn), 1.0);
  EXPECT_GT(Repeated(features, turned, 1e-3, 1e-3, 20, turn), 0.95);
}

TEST(Surf, DoublingTheImageDoublesPositionsAndScales) {
  const auto small = Detect(BlobTexture(320, 260, 5), {.hessian_threshold = 40}),
             large = Detect(BlobTexture(320, 260, 5, 2.0), {.hessian_threshold = 10});
  const double repeated = Repeated(small, large, 2, 0.35, 110, [](Keypoint k) {
    k.x_px *= 2, k.y_px *= 2, k.scale_px *= 2;
    return k;
  });
  RecordProperty("repeated", std::to_string(repeated));
  EXPECT_GT(repeated, 0.6);
}

TEST(Surf, BrightnessAndContrastDoNotChangeDescriptors) {
  const GreyImage image = BlobTexture(300, 260, 6);
  GreyImage other = image;
  for (auto& v : other.u8) v = static_cast<std::uint8_t>(v / 2 + 90);
  const auto a = Detect(image, {.hessian_threshold = 40}), b = Detect(other, {.hessian_threshold = 5});
  EXPECT_GT(Repeated(a, b, 0.5, 0.2, 40, [](Keypoint k) { return k; }), 0.9);
  // An offset alone changes nothing at all: every wavelet sums to zero.
  GreyImage brighter = image;
  for (auto& v : brighter.u8) v = static_cast<std::uint8_t>(std::min<int>(v, 225));
  GreyImage base = brighter;
  for (auto& v : brighter.u8) v = static_cast<std::uint8_t>(v + 30);
  EXPECT_TRUE(AreSame(Detect(base), Detect(brighter)));
}

TEST(Surf, DepthOfPixelsDoesNotMatter) {
  const GreyImage image = BlobTexture(260, 240, 7);
  const auto features = Detect(image);
  EXPECT_TRUE(AreSame(features, Detect(Deepen(image, 1))));
  EXPECT_TRUE(AreSame(features, Detect(Deepen(image, 16))));
  EXPECT_GT(Repeated(features, Detect(Deepen(image, 257)), 0.1, 0.1, 20, [](Keypoint k) { return k; }), 0.95);
}

TEST(Surf, AnyTilingGivesTheSameBytes) {
  for (const auto& [width_px, height_px] : {std::pair{1130, 420}, {333, 701}}) {
    const GreyImage image = BlobTexture(width_px, height_px, 8);
    const auto whole = Detect(image, {}, {.strip_width_px = 1 << 20, .chunks = 1});
    ASSERT_GT(whole.size(), 500U);
    for (const int strip_px : {37, 64, 512, 1024, 4096}) {
      for (const int chunks : {1, 3, 8})
        EXPECT_TRUE(AreSame(whole, Detect(image, {}, {strip_px, chunks}))) << strip_px << " " << chunks;
    }
  }
}

TEST(Surf, AStripBorderMayCrossAFeatureAnywhere) {
  // One large feature: the outermost samples of its descriptor need the whole halo.
  const GreyImage image = BlobTexture(700, 520, 9);
  const auto whole = Detect(image, {}, {.strip_width_px = 1 << 20, .chunks = 1});
  const auto largest = std::max_element(whole.begin(), whole.end(), [](const Feature& a, const Feature& b) {
    return a.keypoint.scale_px < b.keypoint.scale_px;
  });
  ASSERT_GT(largest->keypoint.scale_px, 0.8 * surf::LargestScale_px() * 147 / 195);
  const int x = static_cast<int>(largest->keypoint.x_px);
  for (int border = x - 12; border <= x + 12; border += 3)
    ASSERT_TRUE(AreSame(whole, Detect(image, {}, {.strip_width_px = border, .chunks = 2}))) << border - x;
}

TEST(Surf, EveryKernelGivesTheSameBytes) {
  SerialRunContext context;
  for (const int gain : {0, 1, 200}) {
    const GreyImage grey = BlobTexture(401, 333, 10), image = gain == 0 ? grey : Deepen(grey, gain);
    for (const int elements : {64, 128}) {
      const SurfOptions options{.hessian_threshold = 2, .elements = elements};
      const auto expected = DetectSurf({.image = image}, options, {}, context, ChooseSurfKernels("scalar"));
      ASSERT_GT(expected.size(), 300U);
      for (const SurfKernels& kernels : AllSurfKernels()) {
        if (!kernels.is_supported) continue;
        EXPECT_TRUE(AreSame(expected, DetectSurf({.image = image}, options, {}, context, kernels))) << kernels.name;
      }
    }
  }
  EXPECT_THROW(ChooseSurfKernels("sse5"), Error);
}

TEST(Surf, TinyBlackAndFlatImagesHaveNoFeatures) {
  SerialRunContext context;
  EXPECT_TRUE(Detect({}).empty());
  for (const auto& [w, h] : {std::pair{1, 1}, {1, 400}, {400, 1}, {2, 3}, {8, 8}, {22, 22}})
    EXPECT_TRUE(Detect(BlobTexture(w, h, 11)).empty()) << w << "x" << h;
  GreyImage flat = BlobTexture(200, 150, 12);
  for (const std::uint8_t value : {0, 255}) {
    std::fill(flat.u8.begin(), flat.u8.end(), value);
    EXPECT_TRUE(Detect(flat, {.hessian_threshold = 0}).empty());
    EXPECT_TRUE(Detect(Deepen(flat, 257), {.hessian_threshold = 0}).empty());
  }
  for (int side_px = 23; side_px < 60; ++side_px)
    Detect(BlobTexture(side_px, 83 - side_px, 13), {.hessian_threshold = 0});
}

TEST(Surf, MemoryIsThatOfTheStrips) {
  // A ring of integral rows for each chunk, whatever the height of the image.
  EXPECT_LT(SurfPeakBytes(12'000, {.strip_width_px = 512, .chunks = 2}), 16U << 20);
  EXPECT_EQ(SurfPeakBytes(12'000, {.strip_width_px = 512, .chunks = 8}),
            4 * SurfPeakBytes(12'000, {.strip_width_px = 512, .chunks = 2}));
}

TEST(Surf, AStopRequestEndsIt) {
  class Stopped : public SerialRunContext {
    bool StopRequested() const override { return true; }
  } context;
  const GreyImage image = BlobTexture(64, 64, 14);
  EXPECT_THROW(DetectSurf({.image = image}, {}, {}, context), Cancelled);
}

}  // namespace
}  // namespace rilievo::features
