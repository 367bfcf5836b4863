// Normalises descriptors and packs them into bytes (docs/decisions/0010).
#pragma once

#include "block/features.h"

namespace rilievo::features {

/// Lowe 2004, section 6.1: unit norm, components cut at 0.2, unit norm again; RootSIFT (Arandjelovic & Zisserman 2012):
/// square roots of the components over their sum. Scaled to norm 512, rounded, at most 255. The zero histogram gives
/// zeros. Sums run over 16 lanes and then up a fixed tree.
Descriptor SiftBytes(const float* histogram, bool root);

/// Sum of the squares in the same order; `count` is a multiple of 16.
float SquaredNorm(const float* values, int count);

/// Scaled to unit length; zeros stay zeros. `count` is a multiple of 16.
void Normalise(float* values, int count);

/// At most 128 signed components, `count` a multiple of 16: byte = clamp(round(128 + c)), 128 where there is none.
/// Longer vectors than kMostSignedNorm are shortened to it.
Descriptor SignedBytes(const float* values, int count);

/// Rounding adds at most sqrt(128) / 2: the squared norm from 128 stays within the 78,400 of the matching's kernels.
inline constexpr float kMostSignedNorm = 274.0F;

}  // namespace rilievo::features
