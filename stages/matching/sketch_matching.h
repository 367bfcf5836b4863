// Exact matches from a sweep of sketches: most neighbours are ruled out by bounds, the others compared in full.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/run_context.h"
#include "stages/matching/ratio_test.h"
#include "stages/matching/two_nearest.h"

namespace rilievo::matching {

/// A descriptor of a, its nearest neighbour in b, which passes the ratio test, and their squared distance.
struct PassingNeighbor {
  std::uint32_t first = 0, second = 0;
  std::int32_t distance_sq = 0;
};

/// What a pair took beside the sweep of its sketches, for measuring.
struct SketchCounts {
  std::size_t full_rows = 0, full_columns = 0;
};

/// Images that have sketches and enough descriptors for the bounds to be worth their cost.
bool CanMatchBySketches(const Prepared& a, const Prepared& b);

/// All descriptors of a that pass the ratio test, ascending; with `mutual` only those whose neighbour passes it too
/// and names them. The same as from FindTwoNearest's tables, by less than a whole sweep (docs/decisions/0014).
/// Precondition: CanMatchBySketches.
std::vector<PassingNeighbor> MatchBySketches(const Prepared& a, const Prepared& b, const RatioTest& test, bool mutual,
                                             const RunContext& context, SketchCounts* counts = nullptr);

/// Upper bound of the bytes it holds beside the prepared images.
std::size_t MatchBySketchesBytes(std::size_t a, std::size_t b);

}  // namespace rilievo::matching
