// Sorts both images' descriptors by cell and sweeps cell by cell (docs/decisions/0011-kd-tree-matching.md).
#include "stages/matching/cells.h"

#include <algorithm>
#include <bit>
#include <numeric>

#include "stages/matching/best_two.h"
#include "stages/matching/cell_centers.h"
#include "stages/matching/distance_kernels.h"

namespace rilievo::matching {
namespace {

constexpr std::size_t kPointsPerCell = 512, kMostCells = 512;
/// Rows that a sweep against one cell gathers at once: 1 MB.
constexpr std::size_t kRowsPerSweep = 8064;
/// Descriptors whose cells are found between two polls for a stop: some milliseconds.
constexpr std::size_t kPerPoll = 8192;

/// Indices of descriptors by cell, ascending within each: those of cell c are members[begins[c], begins[c + 1]).
struct Lists {
  std::vector<std::size_t> begins;
  std::vector<std::uint32_t> members;

  std::span<const std::uint32_t> Of(std::size_t cell) const {
    return std::span(members).subspan(begins[cell], begins[cell + 1] - begins[cell]);
  }
};

/// cells: `each` cells a descriptor.
Lists SortByCell(std::span<const std::uint16_t> cells, std::size_t each, std::size_t cell_count) {
  Lists lists{.begins = std::vector<std::size_t>(cell_count + 1, 0),
              .members = std::vector<std::uint32_t>(cells.size())};
  for (const std::uint16_t cell : cells) ++lists.begins[cell + std::size_t{1}];
  std::partial_sum(lists.begins.begin(), lists.begins.end(), lists.begins.begin());
  std::vector<std::size_t> next(lists.begins.begin(), lists.begins.end() - 1);
  for (std::size_t i = 0; i < cells.size(); ++i) lists.members[next[cells[i]]++] = static_cast<std::uint32_t>(i / each);
  return lists;
}

/// The `visits` cells nearest to every descriptor, ties to the lower cell.
std::vector<std::uint16_t> NearestCells(std::span<const Descriptor> descriptors, std::span<const Descriptor> centers,
                                        std::size_t visits, DistanceKernel distances, const RunContext& context) {
  std::vector<std::uint32_t> all(centers.size());
  std::iota(all.begin(), all.end(), 0U);
  std::vector<std::int32_t> distances_sq(centers.size());
  std::vector<std::uint64_t> keys(centers.size());
  std::vector<std::uint16_t> cells(descriptors.size() * visits);
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    if (i % kPerPoll == 0) context.ThrowIfStopped();
    distances(descriptors[i].data(), centers.front().data(), all.data(), all.size(), distances_sq.data());
    for (std::size_t c = 0; c < keys.size(); ++c) keys[c] = (static_cast<std::uint64_t>(distances_sq[c]) << 16) + c;
    std::nth_element(keys.begin(), keys.begin() + static_cast<std::ptrdiff_t>(visits - 1), keys.end());
    for (std::size_t v = 0; v < visits; ++v) cells[i * visits + v] = static_cast<std::uint16_t>(keys[v]);
  }
  return cells;
}

/// The one cell of every descriptor.
std::vector<std::uint16_t> NearestCell(std::span<const Descriptor> descriptors, std::span<const Descriptor> centers,
                                       const Kernel& kernel, const RunContext& context) {
  std::vector<std::uint16_t> cells;
  cells.reserve(descriptors.size());
  for (std::size_t begin = 0; begin < descriptors.size(); begin += kPerPoll) {
    const auto part = descriptors.subspan(begin, std::min(kPerPoll, descriptors.size() - begin));
    for (const BestTwo& nearest : FindTwoNearest(part, centers, kernel, context).of_a)
      cells.push_back(static_cast<std::uint16_t>(nearest.index));
  }
  return cells;
}

void GatherInto(std::vector<Descriptor>& gathered, std::span<const Descriptor> from,
                std::span<const std::uint32_t> indices) {
  gathered.resize(indices.size());
  for (std::size_t i = 0; i < indices.size(); ++i) gathered[i] = from[indices[i]];
}

/// Adds what a sweep of chosen rows and columns found. Indices of both ascend, so ties stay with the lower one.
void Merge(const NeighborTable& found, std::span<const std::uint32_t> rows, std::span<const std::uint32_t> columns,
           NeighborTable& table) {
  for (std::size_t i = 0; i < rows.size(); ++i) {
    BestTwo best = found.of_a[i];
    best.index = columns[best.index];
    OfferBoth(table.of_a[rows[i]], best);
  }
  for (std::size_t j = 0; j < columns.size(); ++j) {
    BestTwo best = found.of_b[j];
    best.index = rows[best.index];
    OfferBoth(table.of_b[columns[j]], best);
  }
}

}  // namespace

std::size_t CellCount(std::size_t count) {
  return std::clamp(std::bit_floor(count / kPointsPerCell), std::size_t{1}, kMostCells);
}

NeighborTable FindTwoNearestInCells(std::span<const Descriptor> a, std::span<const Descriptor> b, std::size_t visits,
                                    const Kernel& kernel, const RunContext& context) {
  const std::size_t cell_count = CellCount(b.size());
  if (a.empty() || b.empty() || visits >= cell_count) return FindTwoNearest(a, b, kernel, context);
  NeighborTable table{.of_a = std::vector<BestTwo>(a.size()), .of_b = std::vector<BestTwo>(b.size())};
  const std::vector<Descriptor> centers = CellCenters(a, b, cell_count, kernel, context);
  const Lists columns_by_cell = SortByCell(NearestCell(b, centers, kernel, context), 1, cell_count);
  const Lists rows_by_cell =
      SortByCell(NearestCells(a, centers, visits, DistanceKernelOf(kernel.name), context), visits, cell_count);
  std::vector<Descriptor> row_descriptors, column_descriptors;
  for (std::size_t cell = 0; cell < cell_count; ++cell) {
    const auto columns = columns_by_cell.Of(cell), rows = rows_by_cell.Of(cell);
    if (columns.empty()) continue;
    GatherInto(column_descriptors, b, columns);
    for (std::size_t begin = 0; begin < rows.size(); begin += kRowsPerSweep) {
      const auto part = rows.subspan(begin, std::min(kRowsPerSweep, rows.size() - begin));
      GatherInto(row_descriptors, a, part);
      Merge(FindTwoNearest(row_descriptors, column_descriptors, kernel, context), part, columns, table);
    }
  }
  return table;
}

std::size_t TwoNearestInCellsBytes(std::size_t a, std::size_t b, std::size_t visits) {
  const std::size_t cell_count = CellCount(b);
  if (visits >= cell_count) return TwoNearestBytes(a, b) + PackedBytes(a) + PackedBytes(b);
  // Cells of every visit and the lists, one after the other sorted; a cell may hold all of b.
  const std::size_t lists = a * visits * (2 + 4) + b * (2 + 4) + 24 * cell_count;
  const std::size_t gathered = sizeof(Descriptor) * (kRowsPerSweep + 2 * b);
  return sizeof(BestTwo) * (a + b) + cell_count * (sizeof(Descriptor) + 16) + CellCentersBytes(cell_count) + lists +
         gathered + TwoNearestBytes(kRowsPerSweep, b) + PackedBytes(kRowsPerSweep) + PackedBytes(b);
}

}  // namespace rilievo::matching
