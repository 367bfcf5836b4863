// The two nearest neighbours of every descriptor of two images in the other one.
#pragma once

#include <span>
#include <vector>

#include "base/run_context.h"
#include "block/features.h"
#include "stages/matching/matching_kernels.h"
#include "stages/matching/packed_descriptors.h"
#include "stages/matching/sketch.h"

namespace rilievo::matching {

struct NeighborTable {
  std::vector<BestTwo> of_a;  ///< one entry a descriptor of a, neighbours in b
  std::vector<BestTwo> of_b;  ///< one entry a descriptor of b, neighbours in a
};

/// An image's descriptors, which must outlive it, with what the kernel reads of them.
struct Prepared {
  std::span<const Descriptor> descriptors;
  PackedDescriptors packed;
  const Kernel* kernel = nullptr;
  Sketches sketches;  ///< where asked for
};

enum class SketchUse : std::uint8_t { kNever, kWherePaying, kWherePossible };
Prepared Prepare(std::span<const Descriptor> descriptors, const Kernel& kernel, SketchUse sketches = SketchUse::kNever);

/// Exact; the same table from every kernel. Descriptors whose squared norms, measured from 0 (SIFT's is near 512^2) or
/// from 128 (SURF's is near 256^2), exceed what keys hold are compared by the scalar reference whatever the kernel.
/// Both sides are prepared for one kernel. Cost: one sweep of |a| x |b| dot products.
NeighborTable FindTwoNearest(const Prepared& a, const Prepared& b, const RunContext& context);
NeighborTable FindTwoNearest(std::span<const Descriptor> a, std::span<const Descriptor> b, const Kernel& kernel,
                             const RunContext& context);

/// The two nearest neighbours in b of some descriptors of a, in the order of `rows`: the same answers.
std::vector<BestTwo> FindTwoNearestOf(std::span<const std::uint32_t> rows, const Prepared& a, const Prepared& b,
                                      const RunContext& context);

/// Upper bound of the bytes that FindTwoNearest holds beside the prepared images, its result included, for the kernel
/// that needs most.
std::size_t TwoNearestBytes(std::size_t a, std::size_t b);

}  // namespace rilievo::matching
