// Sweeps two images' packed descriptors block by block and decodes the keys (docs/decisions/0006-matching.md).
#include "stages/matching/two_nearest.h"

#include <algorithm>
#include <optional>

#include "base/check.h"
#include "stages/matching/best_two.h"
#include "stages/matching/sweep.h"

namespace rilievo::matching {
namespace {

/// Rows of the scalar reference between two polls for a stop, against all columns.
constexpr std::size_t kScalarComparisonsPerPoll = 1'000'000;

/// A neighbour that another one offered for the same descriptor precedes.
void OfferSecond(BestTwo& best, std::int32_t distance_sq) { best.second_sq = std::min(best.second_sq, distance_sq); }

/// A row key is (d^2 - rest_sq) << 11 plus the number of the vector in its sweep; the lane says the rest. Nearest of
/// the row: the least of the first keys, the lowest lane of equals. Second: the least of all others.
void DecodeRows(std::span<const std::int32_t> keys, std::span<const std::int32_t> rest_sq, std::size_t column_begin,
                std::size_t lanes, std::span<BestTwo> of_a) {
  for (std::size_t i = 0; i < of_a.size(); ++i) {
    const std::int32_t* first = keys.data() + i * 2 * lanes;
    const std::int32_t* second = first + lanes;
    std::int32_t least = BestTwo::kNone, next = BestTwo::kNone;
    for (std::size_t lane = 0; lane < lanes; ++lane) least = std::min(least, first[lane]);
    const auto winner = static_cast<std::size_t>(std::find(first, second, least) - first);
    for (std::size_t lane = 0; lane < lanes; ++lane) next = std::min(next, lane == winner ? second[lane] : first[lane]);
    const std::size_t vector = static_cast<std::uint32_t>(least) % kIndexCount;
    Offer(of_a[i], (least >> kIndexBits) + rest_sq[i],
          static_cast<std::uint32_t>(column_begin + vector * lanes + winner));
    if (next != BestTwo::kNone) OfferSecond(of_a[i], (next >> kIndexBits) + rest_sq[i]);
  }
}

/// A column key is d^2 << 11 plus the numbers of the vector (known from the place) and of the row in its block.
void DecodeColumns(std::span<const std::int32_t> keys, std::size_t row_begin, std::size_t lanes,
                   std::span<BestTwo> of_b) {
  for (std::size_t begin = 0, vector = 0; begin < of_b.size(); begin += lanes, ++vector) {
    const std::int32_t* first = keys.data() + 2 * begin;
    const std::int32_t* second = first + lanes;
    const auto number = static_cast<std::int32_t>(vector);
    for (std::size_t lane = 0; lane < std::min(lanes, of_b.size() - begin); ++lane) {
      BestTwo& best = of_b[begin + lane];
      const std::int32_t plain = first[lane] - number;
      Offer(best, plain >> kIndexBits,
            static_cast<std::uint32_t>(row_begin + static_cast<std::uint32_t>(plain) % kIndexCount));
      if (second[lane] != BestTwo::kNone) OfferSecond(best, (second[lane] - number) >> kIndexBits);
    }
  }
}

void SweepAll(const PackedDescriptors& a, const PackedDescriptors& b, const Kernel& kernel, const RunContext& context,
              NeighborTable& table) {
  Sweep(a, b, kernel, context, [&](const SweptBlock& block) {
    DecodeRows(block.row_keys, std::span(a.rest_sq).subspan(block.row_begin, block.rows), block.column_begin,
               kernel.lanes, std::span(table.of_a).subspan(block.row_begin, block.rows));
    DecodeColumns(block.column_keys, block.row_begin, kernel.lanes,
                  std::span(table.of_b).subspan(block.column_begin, block.columns));
  });
}

void CompareAllScalar(std::span<const Descriptor> a, std::span<const Descriptor> b, NeighborTable& table,
                      const RunContext& context) {
  const std::size_t step = 1 + kScalarComparisonsPerPoll / (b.size() + 1);
  for (std::size_t row = 0; row < a.size(); row += step) {
    context.ThrowIfStopped();
    CompareScalar(a.front().data(), row, std::min(row + step, a.size()), b.front().data(), b.size(), table.of_a.data(),
                  table.of_b.data());
  }
}

}  // namespace

std::size_t TwoNearestBytes(std::size_t a, std::size_t b) {
  constexpr std::size_t kMostColumns = kIndexCount * 16;
  return sizeof(BestTwo) * (a + b) + 8 * (std::min(b, kMostColumns) + 64) + 128 * kRowsPerBlock;
}

Prepared Prepare(std::span<const Descriptor> descriptors, const Kernel& kernel, SketchUse sketches) {
  Prepared prepared{descriptors, Pack(descriptors, kernel), &kernel, {}};
  // Their bounds hold for norms up to what the keys around 0 hold.
  const bool possible = sketches != SketchUse::kNever && prepared.packed.centers.zero;
  if (possible && (sketches == SketchUse::kWherePossible || SketchesPay(descriptors)))
    prepared.sketches = MakeSketches(descriptors, kernel);
  return prepared;
}

NeighborTable FindTwoNearest(const Prepared& a, const Prepared& b, const RunContext& context) {
  RILIEVO_CHECK(a.kernel == b.kernel);
  const Kernel& kernel = *a.kernel;
  NeighborTable table{.of_a = std::vector<BestTwo>(a.descriptors.size()),
                      .of_b = std::vector<BestTwo>(b.descriptors.size())};
  if (a.descriptors.empty() || b.descriptors.empty()) return table;
  if (a.packed.IsPacked() && b.packed.IsPacked() && a.packed.center == b.packed.center) {
    SweepAll(a.packed, b.packed, kernel, context, table);
    return table;
  }
  // One image's norms allow 0 and the other one's do not, or neither centre is allowed: rare.
  if (a.packed.centers.middle && b.packed.centers.middle) {
    SweepAll(Pack(a.descriptors, kernel, kSignedCenter), Pack(b.descriptors, kernel, kSignedCenter), kernel, context,
             table);
  } else {
    CompareAllScalar(a.descriptors, b.descriptors, table, context);
  }
  return table;
}

std::vector<BestTwo> FindTwoNearestOf(std::span<const std::uint32_t> rows, const Prepared& a, const Prepared& b,
                                      const RunContext& context) {
  std::vector<Descriptor> chosen;
  chosen.reserve(rows.size());
  for (const std::uint32_t row : rows) chosen.push_back(a.descriptors[row]);
  return FindTwoNearest(Prepare(chosen, *a.kernel), b, context).of_a;
}

NeighborTable FindTwoNearest(std::span<const Descriptor> a, std::span<const Descriptor> b, const Kernel& kernel,
                             const RunContext& context) {
  return FindTwoNearest(Prepare(a, kernel), Prepare(b, kernel), context);
}

}  // namespace rilievo::matching
