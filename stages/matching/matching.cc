// Ratio test, mutual check and one-to-one matches from the tables of nearest neighbours.
#include "stages/matching/matching.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "base/check.h"
#include "stages/matching/cells.h"
#include "stages/matching/kd_matching.h"
#include "stages/matching/ratio_test.h"
#include "stages/matching/sketch_matching.h"
#include "stages/matching/two_nearest.h"

namespace rilievo::matching {
namespace {

/// The kernel of this processor or of RILIEVO_KERNELS, read once.
const Kernel& ProcessKernel() {
  static const Kernel& kernel = []() -> const Kernel& {
    const char* forced = std::getenv("RILIEVO_KERNELS");
    return ChooseKernel(forced == nullptr ? "" : forced);
  }();
  return kernel;
}

constexpr KernelName kM2Kernel{"m2", KernelName::Arithmetic::kBytes};
/// Counted are the products of sketches: what is compared in full beside them adds to the time alone.
constexpr KernelName kSketchKernel{"m2 by sketches", KernelName::Arithmetic::kBytes};
constexpr double kBytesADescriptor = sizeof(Descriptor), kBytesASketch = sizeof(Sketch);

double Comparisons(const Prepared& a, const Prepared& b) {
  return static_cast<double>(a.descriptors.size()) * static_cast<double>(b.descriptors.size());
}

bool MaySweep(const Options& options) { return options.matcher == "auto" || options.matcher == "m2"; }

/// Neighbours of a and, for a mutual check, of b.
NeighborTable FindNeighbors(const Prepared& a, const Prepared& b, const Options& options, RunContext& context) {
  switch (MatcherFor(a.descriptors.size(), b.descriptors.size(), options)) {
    case Matcher::kKdTree:
      return FindTwoNearestByTrees(a.descriptors, b.descriptors, static_cast<std::size_t>(options.kd_checks),
                                   options.mutual, *a.kernel, context);
    case Matcher::kCells:
      return FindTwoNearestInCells(a.descriptors, b.descriptors, static_cast<std::size_t>(options.visited_cells),
                                   *a.kernel, context);
    case Matcher::kM2:
      break;
  }
  NeighborTable table;
  context.RunKernel(kM2Kernel, kBytesADescriptor * Comparisons(a, b), [&] { table = FindTwoNearest(a, b, context); });
  return table;
}

/// Of two descriptors by m2. Costs alone depend on the kernel, never a choice that a result follows from.
double SecondsPerComparison() {
  const Kernel& kernel = ProcessKernel();
  if (kernel.sweep == nullptr) return 1e-8;
  return kernel.encoding == Encoding::kBytes ? 0.3e-9 : 1.3e-9;
}

/// The descriptors of a that pass, with `mutual` from both sides.
std::vector<PassingNeighbor> Passing(const NeighborTable& table, const RatioTest& test, bool mutual) {
  std::vector<PassingNeighbor> passing;
  for (std::uint32_t i = 0; i < table.of_a.size(); ++i) {
    const BestTwo& best = table.of_a[i];
    if (!test.Passes(best)) continue;
    if (mutual && (table.of_b[best.index].index != i || !test.Passes(table.of_b[best.index]))) continue;
    passing.push_back({i, best.index, best.first_sq});
  }
  return passing;
}

/// Without the mutual check several rows may want one column: the nearest gets it, the lowest of equals.
std::vector<Match> OneToOne(std::span<const PassingNeighbor> passing, std::size_t columns) {
  std::vector<const PassingNeighbor*> claim(columns, nullptr);
  for (const PassingNeighbor& neighbor : passing) {
    const PassingNeighbor*& owner = claim[neighbor.second];
    if (owner == nullptr || neighbor.distance_sq < owner->distance_sq) owner = &neighbor;
  }
  std::vector<Match> matches;
  for (const PassingNeighbor& neighbor : passing)
    if (claim[neighbor.second] == &neighbor) matches.push_back({neighbor.first, neighbor.second});
  return matches;
}

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
      {"matcher",
       &Options::matcher,
       0,
       0,
       "",
       "m2 compares all features with all (exact); cells and kd-tree are approximate; auto: m2 up to 2^32 comparisons "
       "a "
       "pair (65,536 features by 65,536), cells beyond",
       {"auto", "m2", "cells", "kd-tree"}},
      {"kd-checks",
       &Options::kd_checks,
       0,
       1e6,
       "",
       "kd-tree: features compared with each one at most; 0 = as many as exact neighbours take (slow)",
       {}},
      {"visited-cells",
       &Options::visited_cells,
       1,
       512,
       "",
       "cells: of up to 512 cells of similar features, how many are compared with each feature; more miss fewer "
       "matches",
       {}},
  };
  return declarations;
}

Matcher MatcherFor(std::size_t features_a, std::size_t features_b, const Options& options) {
  if (options.matcher == "kd-tree") return Matcher::kKdTree;
  if (options.matcher == "cells") return Matcher::kCells;
  if (options.matcher == "m2") return Matcher::kM2;
  return std::uint64_t{features_a} * features_b > kMostM2Comparisons ? Matcher::kCells : Matcher::kM2;
}

TaskCost Estimate(std::size_t features_a, std::size_t features_b, const Options& options) {
  const auto a = static_cast<double>(features_a), b = static_cast<double>(features_b);
  const std::size_t fewer = std::min(features_a, features_b);
  const auto visits = static_cast<std::size_t>(options.visited_cells);
  // Of no matcher fewer features may take more: the greater of the two that `auto` chooses from.
  const std::size_t packed_bytes = PreparedBytes(features_a, options) + PreparedBytes(features_b, options);
  std::size_t table_bytes =
      packed_bytes + std::max(TwoNearestBytes(features_a, features_b), MatchBySketchesBytes(features_a, features_b));
  double work = SecondsPerComparison() * a * b;
  switch (MatcherFor(features_a, features_b, options)) {
    case Matcher::kM2:
      break;
    case Matcher::kKdTree: {
      const auto checks = static_cast<std::size_t>(options.kd_checks);
      table_bytes = TwoNearestByTreesBytes(features_a, features_b, checks);
      const double compared = checks == 0 ? std::max(a, b) : static_cast<double>(checks);
      work = (a + b) * (2e-6 + 2e-8 * compared);
      break;
    }
    case Matcher::kCells:
      // `auto` has prepared both images for m2 before it knows of the pair.
      table_bytes = std::max(table_bytes, packed_bytes + TwoNearestInCellsBytes(features_a, features_b, visits));
      work *= std::min(1.0, 1.1 * options.visited_cells / static_cast<double>(CellCount(features_b)));
      work += 2e-9 * a * static_cast<double>(CellCount(features_b));
      break;
  }
  return {.peak_bytes = (1 << 16) + table_bytes + 8 * features_b + 3 * sizeof(Match) * fewer, .work = work};
}

std::size_t PreparedBytes(std::size_t features, const Options& options) {
  if (!MaySweep(options)) return 0;
  const Encoding encoding = ProcessKernel().encoding;
  return PackedBytes(features, kDescriptorBytes, encoding) + PackedBytes(features, kSketchBytes, encoding) +
         sizeof(Sketch) * features;
}

Prepared Prepare(std::span<const Descriptor> descriptors, const Options& options) {
  return MaySweep(options) ? Prepare(descriptors, ProcessKernel(), SketchUse::kWherePaying)
                           : Prepared{descriptors, {}, &ProcessKernel(), {}};
}

std::vector<Match> Run(std::span<const Descriptor> a, std::span<const Descriptor> b, const Options& options,
                       RunContext& context) {
  return Run(Prepare(a, options), Prepare(b, options), options, context);
}

std::vector<Match> Run(const Prepared& prepared_a, const Prepared& prepared_b, const Options& options,
                       RunContext& context) {
  const std::span<const Descriptor> a = prepared_a.descriptors, b = prepared_b.descriptors;
  const RatioTest test{std::llround(options.ratio * 1e4)};
  std::vector<PassingNeighbor> passing;
  if (MatcherFor(a.size(), b.size(), options) == Matcher::kM2 && CanMatchBySketches(prepared_a, prepared_b))
    context.RunKernel(kSketchKernel, kBytesASketch * Comparisons(prepared_a, prepared_b),
                      [&] { passing = MatchBySketches(prepared_a, prepared_b, test, options.mutual, context); });
  else
    passing = Passing(FindNeighbors(prepared_a, prepared_b, options, context), test, options.mutual);
  return OneToOne(passing, b.size());
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
