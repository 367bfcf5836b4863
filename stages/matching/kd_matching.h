// The two nearest neighbours by k-d trees of the two images of a pair.
#pragma once

#include <cstddef>
#include <span>

#include "base/run_context.h"
#include "block/features.h"
#include "stages/matching/two_nearest.h"

namespace rilievo::matching {

/// Trees of an approximate search; an exact one has one tree.
inline constexpr int kKdTrees = 4;

/// Neighbours of a's descriptors from trees of b's and, if `both_ways`, the other way round (else of_b is empty).
/// `checks` descriptors are compared for each, or somewhat more (the last leaf is finished); 0: as many as it
/// takes, then the table is that of FindTwoNearest. The same table from every kernel.
/// Cost: 0.1 to 0.3 us a level of the trees and 10 to 20 ns a check.
NeighborTable FindTwoNearestByTrees(std::span<const Descriptor> a, std::span<const Descriptor> b, std::size_t checks,
                                    bool both_ways, const Kernel& kernel, const RunContext& context);

/// Upper bound of the bytes that FindTwoNearestByTrees holds, its result included.
std::size_t TwoNearestByTreesBytes(std::size_t a, std::size_t b, std::size_t checks);

}  // namespace rilievo::matching
