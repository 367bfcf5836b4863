// Are the features the same bytes whatever the tiles, the threads and the kernels, and if not, how many differ?
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <utility>

#include "base/error.h"
#include "base/hash.h"
#include "bench/accuracy/features_detectors.h"
#include "bench/accuracy/features_eval.h"
#include "bench/accuracy/features_threads.h"

namespace rilievo::bench {
namespace {

static_assert(sizeof(Keypoint) == 9 * 4, "a keypoint without padding is hashed as its bytes");

template <class T>
std::string Bytes(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

/// Keypoints, then descriptors, then colours.
std::string Bytes(const ImageFeatures& f) { return Bytes(f.keypoints) + Bytes(f.descriptors) + Bytes(f.colors); }

std::string Hash(const ImageFeatures& f) {
  return KeyHasher().Add(Bytes(f.keypoints)).Add(Bytes(f.descriptors)).Add(Bytes(f.colors)).Finish().Hex();
}

/// Position, scale and angle are the same feature's: 0.01 px, 1 %, 0.01 rad; the descriptor's bytes differ by 4 at
/// most.
bool Same(const Keypoint& a, const Descriptor& da, const Keypoint& b, const Descriptor& db) {
  if (std::abs(a.x_px - b.x_px) > 0.01F || std::abs(a.y_px - b.y_px) > 0.01F) return false;
  if (std::abs(a.scale_px - b.scale_px) > 0.01F * a.scale_px) return false;
  if (std::abs(std::remainder(a.angle_rad - b.angle_rad, 6.2831853F)) > 0.01F) return false;
  return std::equal(da.begin(), da.end(), db.begin(), [](int x, int y) { return std::abs(x - y) <= 4; });
}

/// Share of the larger set that has no partner of its own in the other one. 1 when one of them alone is empty.
double DifferingShare(const ImageFeatures& a, const ImageFeatures& b) {
  const std::size_t larger = std::max(a.keypoints.size(), b.keypoints.size());
  if (larger == 0) return 0;
  std::vector<std::size_t> order(b.keypoints.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(),
            [&](std::size_t i, std::size_t j) { return b.keypoints[i].y_px < b.keypoints[j].y_px; });
  std::vector<bool> taken(order.size());
  std::size_t partners = 0;
  for (std::size_t i = 0; i < a.keypoints.size(); ++i) {
    const float y = a.keypoints[i].y_px;
    auto it = std::lower_bound(order.begin(), order.end(), y - 0.02F,
                               [&](std::size_t j, float value) { return b.keypoints[j].y_px < value; });
    for (; it != order.end() && b.keypoints[*it].y_px < y + 0.02F; ++it) {
      if (taken[*it] || !Same(a.keypoints[i], a.descriptors[i], b.keypoints[*it], b.descriptors[*it])) continue;
      taken[*it] = true;
      ++partners;
      break;
    }
  }
  return 1 - static_cast<double>(partners) / static_cast<double>(larger);
}

struct Variant {
  std::string tiles;
  int threads = 1;
  std::optional<ImageFeatures> features;
};

std::vector<Variant> RunVariants(const GreyImage& image) {
  const features::Options options = AllFeatures();
  std::vector<Variant> variants;
  for (const int threads : {1, 2}) {
    ThreadedRunContext context(threads);
    variants.push_back({"own", threads, DetectOurs(image, options, context)});
    for (const auto& [name, width_px] : {std::pair{"512", 512}, {"1024", 1024}, {"4096", 4096}, {"whole", 0}}) {
      variants.push_back({name, threads, DetectOursTiled(image, options, width_px, context)});
    }
  }
  return variants;
}

void WriteDump(const std::string& path, const ImageFeatures& features) {
  std::ofstream out(path, std::ios::binary);
  const std::uint64_t count = features.keypoints.size();
  out.write(reinterpret_cast<const char*>(&count), sizeof count);
  const std::string bytes = Bytes(features);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  if (!out.flush()) throw Error(ErrorCode::kIo, path, "cannot be written");
}

ImageFeatures ReadDump(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  std::uint64_t count = 0;
  if (bytes.size() >= sizeof count) std::memcpy(&count, bytes.data(), sizeof count);
  if (count == 0 || bytes.size() != sizeof count + count * (sizeof(Keypoint) + sizeof(Descriptor) + sizeof(Rgb)))
    throw Error(ErrorCode::kUnreadable, path, "is not a dump of features");
  ImageFeatures features;
  features.keypoints.resize(count);
  features.descriptors.resize(count);
  const char* from = bytes.data() + sizeof count;
  std::memcpy(features.keypoints.data(), from, count * sizeof(Keypoint));
  std::memcpy(features.descriptors.data(), from + count * sizeof(Keypoint), count * sizeof(Descriptor));
  return features;
}

}  // namespace

Json MeasureIdentity(const std::string& image_path, const std::string& dump_path) {
  const GreyImage image = LoadGrey(image_path);
  const std::vector<Variant> variants = RunVariants(image);
  const ImageFeatures& reference = *variants.front().features;
  Json list = Json::array();
  for (const Variant& v : variants) {
    Json entry{{"tiles", v.tiles}, {"threads", v.threads}, {"hash", nullptr}, {"features", nullptr}};
    if (v.features) {
      entry["hash"] = Hash(*v.features);
      entry["features"] = v.features->keypoints.size();
      entry["differing_share"] = DifferingShare(reference, *v.features);
    }
    list.push_back(std::move(entry));
  }
  WriteDump(dump_path, reference);
  const char* kernels = std::getenv("RILIEVO_KERNELS");
  return {{"image", image_path}, {"width_px", image.width_px}, {"kernels", kernels ? kernels : ""}, {"variants", list}};
}

Json CompareDumps(const std::string& first_path, const std::string& second_path) {
  const ImageFeatures a = ReadDump(first_path), b = ReadDump(second_path);
  return {{"features", {a.keypoints.size(), b.keypoints.size()}}, {"differing_share", DifferingShare(a, b)}};
}

}  // namespace rilievo::bench
