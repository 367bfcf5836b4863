// Means of descriptors that divide the space of descriptors into cells.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "base/run_context.h"
#include "block/features.h"
#include "stages/matching/matching_kernels.h"

namespace rilievo::matching {

/// `cells` centres by Lloyd's iteration over a sample of both images' descriptors, spread evenly over their order. All
/// arithmetic is in integers, means rounded to bytes; a centre that nobody is nearest to stays where it is. Needs at
/// least one descriptor when cells > 0.
std::vector<Descriptor> CellCenters(std::span<const Descriptor> a, std::span<const Descriptor> b, std::size_t cells,
                                    const Kernel& kernel, const RunContext& context);

/// Upper bound of the bytes that CellCenters holds, its result included.
std::size_t CellCentersBytes(std::size_t cells);

}  // namespace rilievo::matching
