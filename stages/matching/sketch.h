// Sketches of descriptors: few coordinates whose distances bound those of the descriptors from below.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "block/features.h"
#include "stages/matching/matching_kernels.h"
#include "stages/matching/packed_descriptors.h"

namespace rilievo::matching {

using Sketch = std::array<std::uint8_t, kSketchBytes>;

/// The sketches of an image's descriptors, packed for a kernel. For any two descriptors x and y of two images,
/// |x - y| >= |sketch(x) - sketch(y)| - error_x - error_y (docs/decisions/0014).
struct Sketches {
  PackedDescriptors packed;
  double error = 0;  ///< of rounding to bytes: the largest of the image's

  bool Exist() const { return packed.IsPacked(); }
};

/// The sketch of a descriptor: the lowest frequencies over the 4 x 4 cells and the 8 directions of a SIFT descriptor,
/// and the norm of the others. `error` gets the norm of what rounding changed.
Sketch SketchOf(const Descriptor& descriptor, double& error);

/// True where the frequencies kept carry most of the descriptors' variance: those of SIFT, not of every descriptor.
bool SketchesPay(std::span<const Descriptor> descriptors);

/// None for the scalar kernel, and where a sketch exceeds what keys hold.
Sketches MakeSketches(std::span<const Descriptor> descriptors, const Kernel& kernel);

}  // namespace rilievo::matching
