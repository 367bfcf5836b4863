// PCA-SIFT: the gradients of a patch (Ke & Sukthankar 2004), projected on their principal components.
#pragma once

#include "block/features.h"
#include "stages/features/sift_kernels.h"

namespace rilievo::features {

/// 41 x 41 samples, half of SIFT's step apart, so that the window is SIFT's; 39 x 39 gradients.
inline constexpr int kPcaSiftPatch = 41, kPcaSiftSide = kPcaSiftPatch - 2;
/// Lowest frequencies kept of each axis: the layer is blurred by sigma, which is 2.7 samples here, so that those above
/// hold nothing.
inline constexpr int kPcaSiftFrequencies = 16;
inline constexpr int kPcaSiftInputs = 2 * kPcaSiftFrequencies * kPcaSiftFrequencies;

/// Bytes a unit of the projected gradients (docs/decisions/0010).
inline constexpr float kPcaSiftGain = 190.0F;

/// Row i, column k of the orthonormal cosine basis (DCT-II) of kPcaSiftSide samples.
double PcaSiftBasis(int sample, int frequency);

/// The 3042 horizontal and vertical gradients of the patch, as one vector of unit norm, in the cosine basis:
/// kPcaSiftInputs floats [horizontal, vertical][frequency across][frequency along]. Zeros for a patch without any
/// gradient. The same for all kernels.
void PcaSiftCoefficients(const SiftKernels& kernels, const Patch& patch, float cosine, float sine, float* coefficients);

/// A Describer: the 36 largest principal components.
Descriptor DescribePcaSift(const SiftKernels& kernels, const Patch& patch, float cosine, float sine);

}  // namespace rilievo::features
