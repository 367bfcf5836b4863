// Sweeps two images' packed descriptors block by block and decodes the keys (docs/decisions/0006-matching.md).
#include "stages/matching/two_nearest.h"

#include <algorithm>
#include <optional>

#include "base/check.h"

namespace rilievo::matching {
namespace {

/// Rows of the scalar reference between two polls for a stop, against all columns.
constexpr std::size_t kScalarComparisonsPerPoll = 1'000'000;

/// Takes one more neighbour into account; ties go to the lower index, so the order of the offers is free.
void Offer(BestTwo& best, std::int32_t distance_sq, std::uint32_t index) {
  if (distance_sq < best.first_sq || (distance_sq == best.first_sq && index < best.index)) {
    best = {.first_sq = distance_sq, .second_sq = best.first_sq, .index = index};
  } else if (distance_sq < best.second_sq) {
    best.second_sq = distance_sq;
  }
}
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

void Sweep(const PackedDescriptors& a, const PackedDescriptors& b, const Kernel& kernel, const RunContext& context,
           NeighborTable& table) {
  const std::size_t lanes = kernel.lanes, width = kernel.PanelColumns(), words = kernel.Words();
  const std::size_t columns_per_sweep = kIndexCount * lanes;
  LineVector<std::int32_t> row_keys(std::min(kRowsPerBlock, a.count) * 2 * lanes);
  LineVector<std::int32_t> column_keys(2 * std::min(columns_per_sweep, b.bases.size()));
  for (std::size_t column = 0; column < b.count; column += columns_per_sweep) {
    const std::size_t columns = std::min(columns_per_sweep, b.count - column);
    for (std::size_t row = 0; row < a.count; row += kRowsPerBlock) {
      context.ThrowIfStopped();
      const std::size_t rows = std::min(kRowsPerBlock, a.count - row);
      std::fill(row_keys.begin(), row_keys.end(), BestTwo::kNone);
      std::fill(column_keys.begin(), column_keys.end(), BestTwo::kNone);
      kernel.sweep({.rows = a.rows.data() + row * words,
                    .row_count = rows,
                    .row_constants = a.constants.data() + row,
                    .panels = b.panels.data() + column * words,
                    .panel_count = (columns + width - 1) / width,
                    .column_bases = b.bases.data() + column,
                    .row_keys = row_keys.data(),
                    .column_keys = column_keys.data()});
      DecodeRows(row_keys, std::span(a.rest_sq).subspan(row, rows), column, lanes,
                 std::span(table.of_a).subspan(row, rows));
      DecodeColumns(column_keys, row, lanes, std::span(table.of_b).subspan(column, columns));
    }
  }
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

Prepared Prepare(std::span<const Descriptor> descriptors, const Kernel& kernel) {
  return {descriptors, Pack(descriptors, kernel), &kernel};
}

NeighborTable FindTwoNearest(const Prepared& a, const Prepared& b, const RunContext& context) {
  RILIEVO_CHECK(a.kernel == b.kernel);
  const Kernel& kernel = *a.kernel;
  NeighborTable table{.of_a = std::vector<BestTwo>(a.descriptors.size()),
                      .of_b = std::vector<BestTwo>(b.descriptors.size())};
  if (a.descriptors.empty() || b.descriptors.empty()) return table;
  if (a.packed.IsPacked() && b.packed.IsPacked() && a.packed.center == b.packed.center) {
    Sweep(a.packed, b.packed, kernel, context, table);
    return table;
  }
  // One image's norms allow 0 and the other one's do not, or neither centre is allowed: rare.
  if (a.packed.centers.middle && b.packed.centers.middle) {
    Sweep(Pack(a.descriptors, kernel, kSignedCenter), Pack(b.descriptors, kernel, kSignedCenter), kernel, context,
          table);
  } else {
    CompareAllScalar(a.descriptors, b.descriptors, table, context);
  }
  return table;
}

NeighborTable FindTwoNearest(std::span<const Descriptor> a, std::span<const Descriptor> b, const Kernel& kernel,
                             const RunContext& context) {
  return FindTwoNearest(Prepare(a, kernel), Prepare(b, kernel), context);
}

}  // namespace rilievo::matching
