// GLOH: gradients in a log-polar grid (Mikolajczyk & Schmid 2005), projected on their principal components.
#pragma once

#include "block/features.h"
#include "stages/features/sift_kernels.h"

namespace rilievo::features {

/// A disc, and two rings of 8 sectors each, around it; 16 directions.
inline constexpr int kGlohSectors = 8, kGlohCells = 1 + 2 * kGlohSectors, kGlohDirections = 16;
inline constexpr int kGlohBins = kGlohCells * kGlohDirections;

/// The paper's radii 6, 11 and 15 in its units, of which the window has 15: the circle in the square of gradients that
/// SIFT samples has a radius of 7.5 sigma.
inline constexpr double kGlohUnits_sigma = 0.5;
inline constexpr double kGlohRadii[3] = {6, 11, 15};

/// Bytes a unit of the projected histogram (docs/decisions/0010).
inline constexpr float kGlohGain = 240.0F;

/// kGlohBins floats [cell][direction], the cell of sector s of ring r being 1 + 8 r + s: unit norm, cut at 0.2, unit
/// norm as SIFT's. Zeros for a patch without any gradient. The same for all kernels.
void GlohHistogram(const SiftKernels& kernels, const Patch& patch, float cosine, float sine, float* histogram);

/// A Describer: the 128 largest principal components of the histogram.
Descriptor DescribeGloh(const SiftKernels& kernels, const Patch& patch, float cosine, float sine);

}  // namespace rilievo::features
