// The block, features, pairs and tracks as bytes.
#include "block/io/serialize_block.h"

#include <numeric>

#include "block/io/serialize_common.h"

namespace rilievo::io {
namespace {

constexpr std::uint32_t kBlockVersion = 1, kFeaturesVersion = 1, kPairsVersion = 1, kMatchesVersion = 1,
                        kTracksVersion = 1;

// Written as raw arrays: they must have no padding, whose bytes would be arbitrary.
static_assert(sizeof(Keypoint) == 5 * sizeof(float) && sizeof(SiftDescriptor) == 128 && sizeof(Rgb) == 3);
static_assert(std::has_unique_object_representations_v<Match> && std::has_unique_object_representations_v<FeatureRef>);

void PutExif(ByteWriter& out, const ExifData& exif) {
  out.Put<std::int32_t>(exif.orientation);
  for (const double value : {exif.focal_mm, exif.focal_35mm_mm, exif.focal_plane_x_res_per_mm}) out.Put(value);
  for (const auto* text : {&exif.make, &exif.model, &exif.serial, &exif.lens, &exif.date_time}) out.PutString(*text);
  out.Put<std::uint8_t>(exif.gnss.has_value());
  if (exif.gnss) out.Put(*exif.gnss);
}

ExifData GetExif(ByteReader& in) {
  ExifData exif;
  exif.orientation = in.Get<std::int32_t>();
  for (double* value : {&exif.focal_mm, &exif.focal_35mm_mm, &exif.focal_plane_x_res_per_mm}) *value = in.Get<double>();
  for (auto* text : {&exif.make, &exif.model, &exif.serial, &exif.lens, &exif.date_time}) *text = in.GetString();
  if (in.Get<std::uint8_t>() != 0) exif.gnss = in.Get<std::array<double, 3>>();
  return exif;
}

using Parameter = double CameraModel::*;
constexpr std::array<Parameter, 12> kParameters{&CameraModel::fx, &CameraModel::fy, &CameraModel::cx, &CameraModel::cy,
                                                &CameraModel::k1, &CameraModel::k2, &CameraModel::p1, &CameraModel::p2,
                                                &CameraModel::k3, &CameraModel::k4, &CameraModel::k5, &CameraModel::k6};

void PutCamera(ByteWriter& out, const Camera& camera) {
  out.Put(static_cast<std::uint8_t>(camera.model.kind));
  for (const Parameter p : kParameters) out.Put(camera.model.*p);
  out.Put<std::int32_t>(camera.width_px);
  out.Put<std::int32_t>(camera.height_px);
  out.Put(static_cast<std::uint8_t>(camera.source));
  out.PutString(camera.label);
}

Camera GetCamera(ByteReader& in) {
  Camera camera;
  const auto kind = in.Get<std::uint8_t>();
  Require(kind <= static_cast<std::uint8_t>(CameraModelKind::kFullOpenCv), "impossible camera model");
  camera.model.kind = static_cast<CameraModelKind>(kind);
  for (const Parameter p : kParameters) camera.model.*p = in.Get<double>();
  camera.width_px = in.Get<std::int32_t>();
  camera.height_px = in.Get<std::int32_t>();
  const auto source = in.Get<std::uint8_t>();
  Require(source <= static_cast<std::uint8_t>(CalibrationSource::kGuessed), "impossible calibration source");
  camera.source = static_cast<CalibrationSource>(source);
  camera.label = in.GetString();
  return camera;
}

void PutImage(ByteWriter& out, const Image& image) {
  out.Put(image.camera_id.value);
  out.PutString(image.name);
  for (const int value : {image.width_px, image.height_px, image.channels, image.bits_per_sample})
    out.Put<std::int32_t>(value);
  PutExif(out, image.exif);
  out.Put(image.content.bytes);
}

Image GetImage(ByteReader& in) {
  Image image;
  image.camera_id = CameraId(in.Get<std::uint32_t>());
  image.name = in.GetString();
  for (int* value : {&image.width_px, &image.height_px, &image.channels, &image.bits_per_sample})
    *value = in.Get<std::int32_t>();
  image.exif = GetExif(in);
  image.content.bytes = in.Get<std::array<std::uint8_t, 32>>();
  return image;
}

Block GetBlock(ByteReader& in) {
  Block block;
  block.cameras.resize(GetCount(in, 8));
  for (std::size_t i = 0; i < block.cameras.size(); ++i) {
    block.cameras[i] = GetCamera(in);
    block.cameras[i].id = CameraId(static_cast<std::uint32_t>(i));
  }
  block.images.resize(GetCount(in, 8));
  for (std::size_t i = 0; i < block.images.size(); ++i) {
    block.images[i] = GetImage(in);
    block.images[i].id = ImageId(static_cast<std::uint32_t>(i));
    const CameraId camera = block.images[i].camera_id;
    Require(!camera.IsValid() || camera.value < block.cameras.size(), "an image without its camera");
  }
  block.quarantined.resize(GetCount(in, 16));
  for (auto& image : block.quarantined) {
    image.name = in.GetString();
    image.reason = in.GetString();
  }
  return block;
}

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

std::vector<Track> GetTracks(ByteReader& in) {
  const auto lengths = in.GetVector<std::uint32_t>();
  const auto elements = in.GetVector<FeatureRef>();
  Require(std::accumulate(lengths.begin(), lengths.end(), std::uint64_t{0}) == elements.size(),
          "tracks of other length than their elements");
  std::vector<Track> tracks(lengths.size());
  auto next = elements.begin();
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    tracks[i].elements.assign(next, next + lengths[i]);
    next += lengths[i];
  }
  return tracks;
}

}  // namespace

std::vector<std::byte> Serialize(const Block& block) {
  ByteWriter out;
  PutHeader(out, PayloadKind::kBlock, kBlockVersion);
  out.Put<std::uint64_t>(block.cameras.size());
  for (const Camera& camera : block.cameras) PutCamera(out, camera);
  out.Put<std::uint64_t>(block.images.size());
  for (const Image& image : block.images) PutImage(out, image);
  out.Put<std::uint64_t>(block.quarantined.size());
  for (const auto& image : block.quarantined) {
    out.PutString(image.name);
    out.PutString(image.reason);
  }
  return out.Take();
}

Block DeserializeBlock(std::span<const std::byte> bytes) {
  return ReadPayload(bytes, PayloadKind::kBlock, kBlockVersion, GetBlock);
}

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
    features.descriptors = in.GetVector<SiftDescriptor>();
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

std::vector<std::byte> Serialize(std::span<const PairMatches> matches) {
  ByteWriter out;
  PutHeader(out, PayloadKind::kMatches, kMatchesVersion);
  out.Put<std::uint64_t>(matches.size());
  for (const PairMatches& pair : matches) {
    out.Put(pair.pair.first.value);
    out.Put(pair.pair.second.value);
    out.PutVector(pair.matches);
  }
  return out.Take();
}

std::vector<PairMatches> DeserializeMatches(std::span<const std::byte> bytes) {
  return ReadPayload(bytes, PayloadKind::kMatches, kMatchesVersion, [](ByteReader& in) {
    std::vector<PairMatches> matches(GetCount(in, 16));
    for (PairMatches& pair : matches) {
      pair.pair.first = ImageId(in.Get<std::uint32_t>());
      pair.pair.second = ImageId(in.Get<std::uint32_t>());
      Require(pair.pair.first < pair.pair.second, "a pair out of order");
      pair.matches = in.GetVector<Match>();
    }
    return matches;
  });
}

std::vector<std::byte> Serialize(std::span<const Track> tracks) {
  ByteWriter out;
  PutHeader(out, PayloadKind::kTracks, kTracksVersion);
  std::vector<std::uint32_t> lengths;
  std::vector<FeatureRef> elements;
  for (const Track& track : tracks) {
    lengths.push_back(static_cast<std::uint32_t>(track.elements.size()));
    elements.insert(elements.end(), track.elements.begin(), track.elements.end());
  }
  out.PutVector(lengths);
  out.PutVector(elements);
  return out.Take();
}

std::vector<Track> DeserializeTracks(std::span<const std::byte> bytes) {
  return ReadPayload(bytes, PayloadKind::kTracks, kTracksVersion, GetTracks);
}

}  // namespace rilievo::io
