// Approximate ways to match beside m2 for 40,000 features and more, from photographs.
#include "bench/accuracy/features_detectors.h"
#include "bench/accuracy/matching_eval.h"

namespace rilievo::bench {
namespace {

/// The `count` strongest features of an image at the lowest threshold that the option takes, edges among them.
std::vector<Descriptor> StrongestOf(const std::string& path, std::size_t count) {
  features::Options options = AllFeatures();
  options.contrast_threshold = 0.001;
  options.edge_threshold = 100;
  SerialRunContext context;
  return Strongest(DetectOurs(LoadGrey(path), options, context), count).descriptors;
}

/// Every other image, from the first or the second on, their features as one image's.
std::vector<Descriptor> Pool(const std::vector<std::string>& images, std::size_t first, std::size_t features) {
  std::vector<Descriptor> pool;
  const std::size_t count = images.size() / 2;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t share = (features - pool.size() + (count - i) - 1) / (count - i);
    const auto strongest = StrongestOf(images[2 * i + first], share);
    pool.insert(pool.end(), strongest.begin(), strongest.end());
  }
  return pool;
}

/// Fewer of them where each takes minutes.
std::vector<int> ChecksFor(std::size_t features) {
  if (features > 300'000) return {256};
  return features > 150'000 ? std::vector<int>{256, 1024} : std::vector<int>{64, 256, 1024};
}

}  // namespace

Json MeasureLarge(std::size_t features, const std::vector<std::string>& images) {
  const auto a = Pool(images, 0, features), b = Pool(images, 1, features);
  const Timed m2 = MatchTimed(a, b, {.matcher = "m2"});
  Json result = {{"features_a", a.size()}, {"features_b", b.size()}, {"m2", BesideReference(m2, m2)}};
  for (const int visits : {4, 8, 12, 16})
    result["cells"][std::to_string(visits)] =
        BesideReference(MatchTimed(a, b, {.matcher = "cells", .visited_cells = visits}), m2);
  for (const int checks : ChecksFor(features))
    result["kd_tree"][std::to_string(checks)] =
        BesideReference(MatchTimed(a, b, {.matcher = "kd-tree", .kd_checks = checks}), m2);
  result["auto"] = BesideReference(MatchTimed(a, b, {}), m2);
  return result;
}

}  // namespace rilievo::bench
