// SIFT keypoints and descriptors of one image (Lowe 2004), by own kernels in strips of bounded memory.
#pragma once

#include <cstddef>
#include <vector>

#include "base/run_context.h"
#include "stages/features/feature.h"
#include "stages/features/octave.h"

namespace rilievo::features {

/// All features of an image in no particular order; two at one place where two directions are as strong. `first_octave`
/// -1 doubles the image, 0 does not. `describe` false leaves out orientation and descriptor. The same bytes for every
/// tiling, number of threads and processor level.
std::vector<Feature> DetectSift(const Input& input, int first_octave, const SiftThresholds& thresholds, bool describe,
                                const Tiling& tiling, const SiftKernels& kernels, RunContext& context);

/// Bytes that DetectSift holds beside the image and its result.
std::size_t SiftWorkspaceBytes(int width_px, int height_px, int first_octave, const Tiling& tiling);

}  // namespace rilievo::features
