// Features and pairs as bytes.
#include "block/io/serialize_block.h"

#include "block/io/serialize_common.h"

namespace rilievo::io {
namespace {

constexpr std::uint32_t kFeaturesVersion = 2, kPairsVersion = 1;

// Written as raw arrays: they must have no padding, whose bytes would be arbitrary.
static_assert(sizeof(Keypoint) == 9 * sizeof(float) && sizeof(Descriptor) == 128 && sizeof(Rgb) == 3);
static_assert(std::has_unique_object_representations_v<Match>);

TwoViewGeometry GetPair(ByteReader& in) {
  TwoViewGeometry pair;
  pair.pair.first = ImageId(in.Get<std::uint32_t>());
  pair.pair.second = ImageId(in.Get<std::uint32_t>());
  const auto model = in.Get<std::uint8_t>(), reason = in.Get<std::uint8_t>();
  Require(pair.pair.first < pair.pair.second, "a pair out of order");
  Require(model <= static_cast<std::uint8_t>(TwoViewModel::kHomography), "impossible two-view model");
  Require(reason <= static_cast<std::uint8_t>(RejectionReason::kNoModel), "impossible reason");
  pair.model = static_cast<TwoViewModel>(model);
  pair.reason = static_cast<RejectionReason>(reason);
  pair.second_from_first = GetPose(in);
  pair.matrix = GetMatrix<3, 3>(in);
  pair.inliers = in.GetVector<Match>();
  pair.matches = in.Get<std::uint32_t>();
  pair.median_angle_rad = in.Get<double>();
  pair.homography_ratio = in.Get<double>();
  return pair;
}

}  // namespace

std::vector<std::byte> Serialize(const ImageFeatures& features) {
  ByteWriter out;
  PutHeader(out, PayloadKind::kFeatures, kFeaturesVersion);
  out.PutVector(features.keypoints);
  out.PutVector(features.descriptors);
  out.PutVector(features.colors);
  return out.Take();
}

ImageFeatures DeserializeFeatures(std::span<const std::byte> bytes) {
  return ReadPayload(bytes, PayloadKind::kFeatures, kFeaturesVersion, [](ByteReader& in) {
    ImageFeatures features;
    features.keypoints = in.GetVector<Keypoint>();
    features.descriptors = in.GetVector<Descriptor>();
    features.colors = in.GetVector<Rgb>();
    const auto fits = [&](std::size_t n) { return n == 0 || n == features.keypoints.size(); };  // parts may be left out
    Require(fits(features.descriptors.size()) && fits(features.colors.size()), "arrays of unequal length");
    return features;
  });
}

std::vector<std::byte> Serialize(std::span<const TwoViewGeometry> pairs) {
  ByteWriter out;
  PutHeader(out, PayloadKind::kPairs, kPairsVersion);
  out.Put<std::uint64_t>(pairs.size());
  for (const TwoViewGeometry& pair : pairs) {
    out.Put(pair.pair.first.value);
    out.Put(pair.pair.second.value);
    out.Put(static_cast<std::uint8_t>(pair.model));
    out.Put(static_cast<std::uint8_t>(pair.reason));
    PutPose(out, pair.second_from_first);
    PutMatrix<3, 3>(out, pair.matrix);
    out.PutVector(pair.inliers);
    out.Put(pair.matches);
    out.Put(pair.median_angle_rad);
    out.Put(pair.homography_ratio);
  }
  return out.Take();
}

std::vector<TwoViewGeometry> DeserializePairs(std::span<const std::byte> bytes) {
  return ReadPayload(bytes, PayloadKind::kPairs, kPairsVersion, [](ByteReader& in) {
    std::vector<TwoViewGeometry> pairs;
    const std::size_t count = GetCount(in, 100);
    pairs.reserve(count);
    for (std::size_t i = 0; i < count; ++i) pairs.push_back(GetPair(in));
    return pairs;
  });
}

}  // namespace rilievo::io
