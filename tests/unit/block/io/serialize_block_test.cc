// Payloads: the value comes back, equal values give equal bytes, and no damage goes unseen or reads outside.
#include "block/io/serialize_block.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>

#include "tests/unit/block/io/scratch_folder.h"
#include "tests/unit/block/io/small_block.h"

namespace rilievo::io {
namespace {

using testing::HasSubstr;
using Bytes = std::vector<std::byte>;

Model ExampleModel() {
  return MakeSmallBlock({TestCamera(CameraModelKind::kFullOpenCv), TestCamera(CameraModelKind::kPinhole)}, 6).model;
}

ImageFeatures ExampleFeatures() {
  ImageFeatures features;
  Rng rng(1);
  for (int i = 0; i < 100; ++i) {
    features.keypoints.push_back({static_cast<float>(rng.Uniform()), 2, 3.5F, -1, static_cast<float>(i)});
    features.descriptors.emplace_back();
    for (auto& value : features.descriptors.back()) value = static_cast<std::uint8_t>(rng.Below(256));
    features.colors.push_back({static_cast<std::uint8_t>(i), 1, 2});
  }
  return features;
}

std::vector<TwoViewGeometry> ExamplePairs() {
  std::vector<TwoViewGeometry> pairs(3);
  for (std::uint32_t i = 0; i < 3; ++i) {
    pairs[i].pair = {ImageId(i), ImageId(i + 2)};
    pairs[i].model = static_cast<TwoViewModel>(i);
    pairs[i].reason = i == 0 ? RejectionReason::kTooFewInliers : RejectionReason::kNone;
    pairs[i].second_from_first = Rigid3(Eigen::Quaterniond(0.9, 0.1, 0.2, 0.3), Eigen::Vector3d(0.6, 0, 0.8));
    pairs[i].matrix << 1, 2, 3, 4, 5, 6, 7, 8, 9.5;
    for (std::uint32_t k = 0; k < 10 * i; ++k) pairs[i].inliers.push_back({k, 2 * k});
    pairs[i].matches = 77;
    pairs[i].median_angle_rad = 0.125;
    pairs[i].homography_ratio = 0.5;
  }
  return pairs;
}

MappingResult ExampleMapping() {
  return {{ExampleModel(), MakeSmallBlock({TestCamera(CameraModelKind::kPinhole)}, 2, 3).model},
          {{ImageId(4), "too few"}}};
}

TEST(Serialize, FeaturesComeBack) {
  const ImageFeatures features = ExampleFeatures(), read = DeserializeFeatures(Serialize(features));
  EXPECT_EQ(read.descriptors, features.descriptors);
  EXPECT_EQ(read.colors, features.colors);
  ASSERT_EQ(read.keypoints.size(), features.keypoints.size());
  EXPECT_EQ(std::memcmp(read.keypoints.data(), features.keypoints.data(), sizeof(Keypoint) * read.keypoints.size()), 0);
  EXPECT_TRUE(DeserializeFeatures(Serialize(ImageFeatures{})).keypoints.empty());
}

TEST(Serialize, PairsComeBack) {
  const auto pairs = ExamplePairs();
  const auto read = DeserializePairs(Serialize(pairs));
  ASSERT_EQ(read.size(), pairs.size());
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    EXPECT_TRUE(read[i].pair == pairs[i].pair && read[i].model == pairs[i].model && read[i].reason == pairs[i].reason);
    EXPECT_EQ(read[i].second_from_first.rotation.coeffs(), pairs[i].second_from_first.rotation.coeffs());
    EXPECT_EQ(read[i].second_from_first.translation, pairs[i].second_from_first.translation);
    EXPECT_EQ(read[i].matrix, pairs[i].matrix);
    EXPECT_EQ(read[i].inliers, pairs[i].inliers);
    EXPECT_TRUE(read[i].matches == 77 && read[i].median_angle_rad == 0.125 && read[i].homography_ratio == 0.5);
  }
}

TEST(Serialize, MappingComesBack) {
  const MappingResult result = ExampleMapping(), read = DeserializeMapping(Serialize(result));
  EXPECT_EQ(Serialize(read), Serialize(result));
  ASSERT_EQ(read.models.size(), 2U);
  const Model &a = result.models[0], &b = read.models[0];
  ASSERT_EQ(a.cam_from_world.size(), b.cam_from_world.size());
  for (const auto& [id, pose] : a.cam_from_world) {
    EXPECT_EQ(b.cam_from_world.at(id).rotation.coeffs(), pose.rotation.coeffs());
    EXPECT_EQ(b.cam_from_world.at(id).translation, pose.translation);
  }
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t p = 0; p < a.points.size(); ++p) {
    EXPECT_EQ(a.points[p].position, b.points[p].position);
    EXPECT_EQ(a.points[p].color, b.points[p].color);
    ASSERT_EQ(a.points[p].observations.size(), b.points[p].observations.size());
    for (std::size_t o = 0; o < a.points[p].observations.size(); ++o) {
      EXPECT_EQ(a.points[p].observations[o].feature, b.points[p].observations[o].feature);
      EXPECT_EQ(a.points[p].observations[o].measured_px, b.points[p].observations[o].measured_px);
      EXPECT_EQ(a.points[p].observations[o].residual_px, b.points[p].observations[o].residual_px);
    }
  }
  EXPECT_TRUE(a.sigma0_px == b.sigma0_px && a.redundancy == b.redundancy);
  EXPECT_TRUE(read.unoriented.at(0).image == ImageId(4) && read.unoriented[0].reason == "too few");
}

template <class Read>
void ExpectDamageIsSeen(const Bytes& bytes, Read read) {
  for (std::size_t keep = 0; keep < bytes.size(); keep += 1 + keep / 8)
    EXPECT_FALSE(ErrorOf([&] { read(std::span(bytes).first(keep)); }).empty());
  Bytes longer = bytes;
  longer.push_back({});
  EXPECT_THAT(ErrorOf([&] { read(longer); }), HasSubstr("after its end"));
  Bytes newer = bytes;
  newer[4] = std::byte{9};
  EXPECT_THAT(ErrorOf([&] { read(newer); }), HasSubstr("version 9"));
  Bytes other = bytes;
  other[0] = std::byte{0};
  EXPECT_THAT(ErrorOf([&] { read(other); }), HasSubstr("not of the kind"));
  // Any byte may turn bad: then it is an Error or another value, never a crash or a huge allocation.
  Rng rng(5);
  for (int i = 0; i < 3000; ++i) {
    Bytes bad = bytes;
    bad[8 +
        rng.Below(static_cast<std::uint32_t>(std::min<std::size_t>(bad.size() - 8, i % 2 ? 200 : bad.size() - 8)))] =
        static_cast<std::byte>(rng.Below(256));
    try {
      read(bad);
    } catch (const Error&) {
    }
  }
}

TEST(Serialize, DamageIsAnError) {
  const auto pairs = ExamplePairs();
  ExpectDamageIsSeen(Serialize(ExampleFeatures()), [](auto bytes) { DeserializeFeatures(bytes); });
  ExpectDamageIsSeen(Serialize(pairs), [](auto bytes) { DeserializePairs(bytes); });
  ExpectDamageIsSeen(Serialize(ExampleMapping()), [](auto bytes) { DeserializeMapping(bytes); });
}

}  // namespace
}  // namespace rilievo::io
