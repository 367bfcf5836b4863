// How a feature of the SIFT detector is described: Lowe's histogram; GLOH and PCA-SIFT are its alternatives.
#pragma once

#include <functional>

#include "block/features.h"
#include "stages/features/sift_kernels.h"

namespace rilievo::features {

/// The descriptor of a patch in the frame turned by the feature's direction. Pure: equal for all kernels.
using Describer = std::function<Descriptor(const SiftKernels&, const Patch&, float cosine, float sine)>;

/// Lowe 2004, section 6; `root` compares by the Hellinger distance (RootSIFT).
Describer SiftDescriber(bool root);

}  // namespace rilievo::features
