// The two nearest neighbours of every descriptor of two images in the other one.
#pragma once

#include <span>
#include <vector>

#include "base/run_context.h"
#include "block/features.h"
#include "stages/matching/matching_kernels.h"

namespace rilievo::matching {

struct NeighborTable {
  std::vector<BestTwo> of_a;  ///< one entry a descriptor of a, neighbours in b
  std::vector<BestTwo> of_b;  ///< one entry a descriptor of b, neighbours in a
};

/// Exact; the same table from every kernel. Descriptors whose squared norms, measured from 0 (SIFT's is near 512^2) or
/// from 128 (SURF's is near 256^2), exceed what keys hold are compared by the scalar reference whatever the kernel.
/// Cost: one sweep of |a| x |b| dot products.
NeighborTable FindTwoNearest(std::span<const Descriptor> a, std::span<const Descriptor> b, const Kernel& kernel,
                             const RunContext& context);

/// Keys are 32 bits: squared distances, eleven bits of index and the sum of two indices must fit. The distance of two
/// descriptors without negative components is at most twice this.
inline constexpr std::int32_t kLargestKeyNorm_sq = 520'000;
/// Zero of signed descriptors, whose squared distance reaches four times the norm, and the bounds from it for kernels
/// of shorts and of bytes (docs/decisions/0010).
inline constexpr std::int32_t kSignedCenter = 128, kLargestSignedShorts_sq = 260'000, kLargestSignedBytes_sq = 78'400;

/// Upper bound of the bytes that FindTwoNearest holds, its result included, for the kernel that needs most.
std::size_t TwoNearestBytes(std::size_t a, std::size_t b);

}  // namespace rilievo::matching
