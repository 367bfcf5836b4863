// Ratio test, mutual check and one-to-one matches from the tables of nearest neighbours.
#include "stages/matching/matching.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "base/check.h"
#include "stages/matching/two_nearest.h"

namespace rilievo::matching {
namespace {

/// d1 < ratio * d2 in integers: d1^2 * 10^8 < round(ratio * 10^4)^2 * d2^2; both sides stay below 2^50. A neighbour
/// without a second one passes: nothing makes it ambiguous.
bool PassesRatio(const BestTwo& best, std::int64_t ratio_e4) {
  if (best.first_sq == BestTwo::kNone) return false;
  if (best.second_sq == BestTwo::kNone) return true;
  return std::int64_t{best.first_sq} * 100'000'000 < ratio_e4 * ratio_e4 * best.second_sq;
}

/// The kernel of this processor or of RILIEVO_KERNELS, read once.
const Kernel& ProcessKernel() {
  static const Kernel& kernel = []() -> const Kernel& {
    const char* forced = std::getenv("RILIEVO_KERNELS");
    return ChooseKernel(forced == nullptr ? "" : forced);
  }();
  return kernel;
}

constexpr std::uint32_t kUnclaimed = 0xffffffffU;

/// The features of one sign, in their order.
struct Part {
  std::vector<std::uint32_t> indices;
  std::vector<Descriptor> descriptors;
};

Part PartOf(const ImageFeatures& features, std::int32_t sign) {
  Part part;
  for (std::uint32_t i = 0; i < features.keypoints.size(); ++i) {
    if (features.keypoints[i].sign != sign) continue;
    part.indices.push_back(i);
    part.descriptors.push_back(features.descriptors[i]);
  }
  return part;
}

}  // namespace

std::span<const OptionDeclaration<Options>> OptionDeclarations() {
  // Positional, all fields given: g++ 12 fails on designated initialisers of this template.
  static const std::vector<OptionDeclaration<Options>> declarations = {
      {"ratio",
       &Options::ratio,
       0.1,
       1.0,
       "",
       "accept a match whose distance is less than this share of the second nearest's",
       {}},
      {"mutual", &Options::mutual, 0, 1, "", "accept a match only if it is found from both images", {}},
  };
  return declarations;
}

TaskCost Estimate(std::size_t features_a, std::size_t features_b, const Options&) {
  const std::size_t fewer = features_a < features_b ? features_a : features_b;
  return {.peak_bytes = (1 << 16) + TwoNearestBytes(features_a, features_b) + PackedBytes(features_a) +
                        PackedBytes(features_b) + 4 * features_b + 3 * sizeof(Match) * fewer,
          .work = 1.5e-9 * static_cast<double>(features_a) * static_cast<double>(features_b)};
}

std::vector<Match> Run(std::span<const Descriptor> a, std::span<const Descriptor> b, const Options& options,
                       RunContext& context) {
  const NeighborTable table = FindTwoNearest(a, b, ProcessKernel(), context);
  const std::int64_t ratio_e4 = std::llround(options.ratio * 1e4);
  // Without the mutual check several rows may want one column: the nearest gets it, the lowest of equals.
  std::vector<std::uint32_t> claim(b.size(), kUnclaimed);
  for (std::uint32_t i = 0; i < a.size(); ++i) {
    const BestTwo& best = table.of_a[i];
    if (!PassesRatio(best, ratio_e4)) continue;
    const BestTwo& back = table.of_b[best.index];
    if (options.mutual && (back.index != i || !PassesRatio(back, ratio_e4))) continue;
    std::uint32_t& owner = claim[best.index];
    if (owner == kUnclaimed || best.first_sq < table.of_a[owner].first_sq) owner = i;
  }
  std::vector<Match> matches;
  for (std::uint32_t i = 0; i < a.size(); ++i) {
    const std::uint32_t j = table.of_a[i].index;
    if (j < b.size() && claim[j] == i) matches.push_back({i, j});
  }
  return matches;
}

std::vector<Match> RunBySign(const ImageFeatures& a, const ImageFeatures& b, const Options& options,
                             RunContext& context) {
  RILIEVO_CHECK(a.keypoints.size() == a.descriptors.size() && b.keypoints.size() == b.descriptors.size());
  std::vector<Match> matches;
  std::vector<std::int32_t> signs;
  for (const Keypoint& k : a.keypoints) signs.push_back(k.sign);
  std::sort(signs.begin(), signs.end());
  signs.erase(std::unique(signs.begin(), signs.end()), signs.end());
  for (const std::int32_t sign : signs) {
    const Part part_a = PartOf(a, sign), part_b = PartOf(b, sign);
    for (const Match& m : Run(part_a.descriptors, part_b.descriptors, options, context)) {
      matches.push_back({part_a.indices[m.first], part_b.indices[m.second]});
    }
  }
  std::sort(matches.begin(), matches.end());
  return matches;
}

}  // namespace rilievo::matching
