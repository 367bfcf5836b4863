// The two nearest neighbours by an inverted file: descriptors sorted into cells, the nearest cells compared in full.
#pragma once

#include <cstddef>
#include <span>

#include "base/run_context.h"
#include "block/features.h"
#include "stages/matching/two_nearest.h"

namespace rilievo::matching {

/// Cells for `count` descriptors: a power of two, 512 descriptors a cell or more, at most 512 cells.
std::size_t CellCount(std::size_t count);

/// Approximate neighbours (inverted file: Sivic & Zisserman, ICCV 2003; Jegou et al., PAMI 2011). The descriptors of b
/// are sorted into cells, each around a mean of descriptors (k-means); one of a is compared with all of its `visits`
/// nearest cells. A column's neighbours are the best of the rows that came by. With as many visits as cells the table
/// is that of FindTwoNearest; with fewer, neighbours in other cells are missed, so the ratio test of a few ambiguous
/// features passes. The same table from every kernel, a pure function of the descriptors.
/// Cost: the share of |a| x |b| dot products that visits are of cells, and |a| distances from every cell.
NeighborTable FindTwoNearestInCells(std::span<const Descriptor> a, std::span<const Descriptor> b, std::size_t visits,
                                    const Kernel& kernel, const RunContext& context);

/// Upper bound of the bytes that FindTwoNearestInCells holds, its result included.
std::size_t TwoNearestInCellsBytes(std::size_t a, std::size_t b, std::size_t visits);

}  // namespace rilievo::matching
