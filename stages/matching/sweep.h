// Sweeps two packed images block by block and gives out the keys of each (docs/decisions/0006-matching.md).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "base/run_context.h"
#include "stages/matching/packed_descriptors.h"

namespace rilievo::matching {

/// The smallest and second smallest keys of a block's rows (by row: one a lane, then the second ones) and columns (by
/// vector of columns: one a column, then the second ones).
struct SweptBlock {
  std::size_t row_begin, rows, column_begin, columns;
  std::span<const std::int32_t> row_keys, column_keys;
};

/// Rows in blocks of kRowsPerBlock against columns in sweeps of kIndexCount vectors, columns outermost.
/// `take(SweptBlock)` is called after each block. Both sides are packed for the kernel, around the same centre.
template <class Take>
void Sweep(const PackedDescriptors& a, const PackedDescriptors& b, const Kernel& kernel, const RunContext& context,
           Take&& take) {
  const std::size_t lanes = kernel.lanes, width = kernel.PanelColumns(), words = a.words;
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
      kernel.sweep({.words = words,
                    .rows = a.rows.data() + row * words,
                    .row_count = rows,
                    .row_constants = a.constants.data() + row,
                    .panels = b.panels.data() + column * words,
                    .panel_count = (columns + width - 1) / width,
                    .column_bases = b.bases.data() + column,
                    .row_keys = row_keys.data(),
                    .column_keys = column_keys.data()});
      take(SweptBlock{row, rows, column, columns, std::span(row_keys).first(rows * 2 * lanes), column_keys});
    }
  }
}

}  // namespace rilievo::matching
