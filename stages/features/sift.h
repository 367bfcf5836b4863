// SIFT keypoints and descriptors of one image (Lowe 2004), by own kernels in strips of bounded memory.
#pragma once

#include <cstddef>
#include <vector>

#include "base/run_context.h"
#include "stages/features/feature.h"
#include "stages/features/octave.h"

namespace rilievo::features {

struct SiftOptions {
  int first_octave = -1;  ///< -1 doubles the image, 0 does not
  SiftThresholds thresholds;
  int octaves = 4;     ///< at most; fewer for small images
  Describer describe;  ///< empty leaves out orientation and descriptor
};

/// The features of an image in no particular order, pruned by the rule; two at one place where two directions are as
/// strong. The same features for every tiling, number of threads and processor level, bit by bit.
std::vector<Feature> DetectSift(const Input& input, const SiftOptions& options, const SelectionRule& rule,
                                const SiftKernels& kernels, RunContext& context);

/// Upper bound of the bytes that DetectSift holds beside the image, its result included.
std::size_t SiftBytesHeld(int width_px, int height_px, const SiftOptions& options, const SelectionRule& rule,
                          const Tiling& tiling);

}  // namespace rilievo::features
