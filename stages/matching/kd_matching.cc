// One forest at a time: built from one image, asked with the other's descriptors.
#include "stages/matching/kd_matching.h"

#include <algorithm>

#include "stages/matching/kd_forest.h"

namespace rilievo::matching {
namespace {

/// Descriptors compared between two polls for a stop: some milliseconds.
constexpr std::size_t kComparisonsPerPoll = 200'000;

int TreesOf(std::size_t checks) { return checks == 0 ? 1 : kKdTrees; }

std::vector<BestTwo> NeighborsOf(std::span<const Descriptor> queries, std::span<const Descriptor> points,
                                 std::size_t checks, DistanceKernel distances, const RunContext& context) {
  context.ThrowIfStopped();
  const KdForest forest(points, TreesOf(checks));
  KdSearch search(forest, distances);
  const std::size_t most = checks == 0 ? points.size() : checks, per_poll = 1 + kComparisonsPerPoll / (1 + most);
  std::vector<BestTwo> neighbors(queries.size());
  for (std::size_t i = 0; i < queries.size(); ++i) {
    if (i % per_poll == 0) context.ThrowIfStopped();
    neighbors[i] = search.Find(queries[i], checks);
  }
  return neighbors;
}

}  // namespace

NeighborTable FindTwoNearestByTrees(std::span<const Descriptor> a, std::span<const Descriptor> b, std::size_t checks,
                                    bool both_ways, const Kernel& kernel, const RunContext& context) {
  const DistanceKernel distances = DistanceKernelOf(kernel.name);
  NeighborTable table;
  table.of_a = NeighborsOf(a, b, checks, distances, context);
  if (both_ways) table.of_b = NeighborsOf(b, a, checks, distances, context);
  return table;
}

std::size_t TwoNearestByTreesBytes(std::size_t a, std::size_t b, std::size_t checks) {
  return sizeof(BestTwo) * (a + b) + KdForestBytes(std::max(a, b), TreesOf(checks));
}

}  // namespace rilievo::matching
