// Normalises a SIFT histogram and packs it into bytes.
#pragma once

#include "block/features.h"

namespace rilievo::features {

/// Lowe 2004, section 6.1: unit norm, components cut at 0.2, unit norm again; RootSIFT (Arandjelovic & Zisserman 2012):
/// square roots of the components over their sum. Scaled to norm 512, rounded, at most 255. The zero histogram gives
/// zeros. Sums run over 16 lanes and then up a fixed tree.
Descriptor SiftBytes(const float* histogram, bool root);

}  // namespace rilievo::features
