// Exact matching of real descriptors: by our kernels beside the peak of their instruction, and by libraries.
#include <algorithm>
#include <functional>
#include <set>

#include "base/error.h"
#include "bench/accuracy/features_clock.h"
#include "bench/accuracy/features_detectors.h"
#include "bench/accuracy/m2_eval.h"
#include "bench/accuracy/m2_peers.h"
#include "engine/peak_loops.h"
#include "stages/matching/matching.h"
#include "stages/matching/sketch_matching.h"
#include "stages/matching/two_nearest.h"

namespace rilievo::bench {
namespace {

using Descriptors = std::vector<Descriptor>;
using Matches = std::set<std::pair<std::uint32_t, std::uint32_t>>;

/// Descriptors of the images in turn until there are `count`; the threshold is low, so that an image has many.
Descriptors Pool(const std::vector<std::string>& images, std::size_t count) {
  features::Options options;
  options.max_features = static_cast<int>((count + images.size() - 1) / images.size());
  options.contrast_threshold = 0.004;
  SerialRunContext context;
  Descriptors pool;
  for (const std::string& path : images) {
    const GreyImage image = LoadGrey(path);
    const ImageFeatures found = DetectOurs(image, options, context);
    pool.insert(pool.end(), found.descriptors.begin(), found.descriptors.end());
  }
  if (pool.size() < count)
    throw Error(ErrorCode::kInvalidInput, images.front(),
                "these images have too few features: " + std::to_string(pool.size()));
  pool.resize(count);
  return pool;
}

struct Sides {
  Descriptors a, b;
};

/// Images of even and odd place, so that neighbours, which overlap, are on different sides.
Sides TwoSides(const std::vector<std::string>& images, std::size_t count) {
  std::vector<std::string> even, odd;
  for (std::size_t i = 0; i < images.size(); ++i) (i % 2 == 0 ? even : odd).push_back(images[i]);
  if (odd.empty()) throw Error(ErrorCode::kUsage, "", "at least two images are needed");
  return {Pool(even, count), Pool(odd, count)};
}

double LeastCpuSeconds(int repeats, const std::function<void()>& work) {
  double least_s = 1e300;
  for (int i = 0; i < repeats; ++i) least_s = std::min(least_s, TimeOf(work).cpu_s);
  return least_s;
}

/// Matches both ways as our matcher defines them, from a peer's tables.
Matches MutualMatches(const std::vector<PeerNeighbors>& of_a, const std::vector<PeerNeighbors>& of_b, double ratio) {
  const auto passes = [&](const PeerNeighbors& n) {
    return n.index[0] >= 0 && n.index[1] >= 0 && n.distance_sq[0] < ratio * ratio * n.distance_sq[1];
  };
  Matches matches;
  for (std::size_t i = 0; i < of_a.size(); ++i) {
    if (!passes(of_a[i])) continue;
    const PeerNeighbors& back = of_b[static_cast<std::size_t>(of_a[i].index[0])];
    if (passes(back) && back.index[0] == static_cast<std::int32_t>(i))
      matches.emplace(static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(of_a[i].index[0]));
  }
  return matches;
}

/// Matches from the whole tables of neighbours: the plain way to the same result.
Matches MutualMatches(const matching::Prepared& a, const matching::Prepared& b, const matching::RatioTest& test) {
  const matching::NeighborTable table = matching::FindTwoNearest(a, b, SerialRunContext());
  Matches matches;
  for (std::uint32_t i = 0; i < table.of_a.size(); ++i) {
    const matching::BestTwo& best = table.of_a[i];
    if (!test.Passes(best)) continue;
    const matching::BestTwo& back = table.of_b[best.index];
    if (back.index == i && test.Passes(back)) matches.emplace(i, best.index);
  }
  return matches;
}

/// Matches of one way that the other lacks.
std::size_t Differences(const std::vector<matching::PassingNeighbor>& found, const Matches& expected) {
  std::size_t common = 0;
  for (const auto& match : found) common += expected.contains({match.first, match.second});
  return found.size() + expected.size() - 2 * common;
}

}  // namespace

Json MeasureM2(std::size_t count, int repeats, const std::vector<std::string>& images) {
  const Sides sides = TwoSides(images, count);
  const SerialRunContext context;
  const double products = 128.0 * static_cast<double>(sides.a.size()) * static_cast<double>(sides.b.size());
  Json result{{"count", count}, {"kernels", Json::object()}};
  for (const matching::Kernel& kernel : matching::AllKernels()) {
    if (!kernel.is_supported || kernel.sweep == nullptr) continue;
    const engine::PeakLoop& loop = kernel.name == "avx512" ? engine::kPeakAvx512 : engine::kPeakAvx2;
    // In turns, and the peak over as long a time as ours: the clock of a core follows what it has done lately.
    const auto prepare = [&](const Descriptors& side) {
      return matching::Prepare(side, kernel, matching::SketchUse::kWherePossible);
    };
    const auto a = prepare(sides.a), b = prepare(sides.b);
    const auto ours = [&] { matching::FindTwoNearest(a, b, context); };
    const double pack_s = LeastCpuSeconds(repeats, [&] { prepare(sides.a); });
    const int loops = static_cast<int>(std::clamp(TimeOf(ours).cpu_s / TimeOf(loop.run).cpu_s, 1.0, 2000.0));
    const auto peak_loop = [&] {
      for (int i = 0; i < loops; ++i) loop.run();
    };
    double ours_s = 1e300, peak_s = 1e300;
    for (int i = 0; i < repeats; ++i) {
      ours_s = std::min(ours_s, TimeOf(ours).cpu_s);
      peak_s = std::min(peak_s, TimeOf(peak_loop).cpu_s / loops);
    }
    const matching::RatioTest test{};
    std::vector<matching::PassingNeighbor> by_sketches;
    matching::SketchCounts counts;
    const double sketches_s =
        LeastCpuSeconds(repeats, [&] { by_sketches = matching::MatchBySketches(a, b, test, true, context, &counts); });
    const double rate = 1e-9 * products / ours_s, peak = 1e-9 * loop.products / peak_s;
    result["kernels"][std::string(kernel.name)] = {{"cpu_s", ours_s},
                                                   {"gmacs_per_s", rate},
                                                   {"peak_gmacs_per_s", peak},
                                                   {"share_of_peak", rate / peak},
                                                   {"pack_s_an_image", pack_s},
                                                   {"mutual_cpu_s", sketches_s},
                                                   {"mutual_share_of_peak", 1e-9 * products / sketches_s / peak},
                                                   {"full_rows", counts.full_rows},
                                                   {"full_columns", counts.full_columns},
                                                   {"differ", Differences(by_sketches, MutualMatches(a, b, test))}};
  }
  SerialRunContext run;
  result["matches"] = matching::Run(sides.a, sides.b, {}, run).size();
  return result;
}

Json MeasurePeer(const std::string& name, std::size_t count, int repeats, const std::vector<std::string>& images) {
  const Sides sides = TwoSides(images, count);
  const auto index_a = MakePeerIndex(name, sides.a), index_b = MakePeerIndex(name, sides.b);
  std::vector<PeerNeighbors> of_a, of_b;
  const double cpu_s = LeastCpuSeconds(repeats, [&] {
    of_a = index_b->Search(sides.a);
    of_b = index_a->Search(sides.b);
  });
  SerialRunContext context;
  const matching::Options options;
  const std::vector<Match> exact = matching::Run(sides.a, sides.b, options, context);
  const auto theirs = MutualMatches(of_a, of_b, options.ratio);
  const auto common = std::count_if(exact.begin(), exact.end(), [&](const Match& m) {
    return theirs.contains({m.first, m.second});
  });
  return {{"name", name},
          {"count", count},
          {"cpu_s", cpu_s},
          {"matches", theirs.size()},
          {"exact_matches", exact.size()},
          {"recall", static_cast<double>(common) / static_cast<double>(std::max<std::size_t>(1, exact.size()))}};
}

}  // namespace rilievo::bench
