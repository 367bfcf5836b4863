// Keypoints and descriptors of one image: the stage, whatever the detector.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "base/option.h"
#include "base/run_context.h"
#include "base/task_cost.h"
#include "block/features.h"
#include "stages/features/feature.h"

namespace rilievo::features {

struct Options {
  std::string detector = "sift";
  int max_features = 16384;
  std::string choice = "strongest";
  int first_octave = -1;
  int octaves = 4;
  double contrast_threshold = 0.015;
  double edge_threshold = 6.0;
  bool root_sift = true;
  double hessian_threshold = 8.0;
};

std::span<const OptionDeclaration<Options>> OptionDeclarations();

/// Bumped whenever Run's result changes for equal input: part of the artifact key.
inline constexpr int kVersion = 2;

/// Whether descriptors of bright and dark blobs must not be compared (matching::RunBySign): SURF's.
bool ComparesEqualSignsOnly(const Options& options);

/// Upper bound of the memory Run holds for an image of this size (its own grey and colour pixels included).
TaskCost Estimate(int width_px, int height_px, int bits_per_sample, const Options& options, const Tiling& tiling);

/// The widest tiling whose estimate fits `budget_bytes`; the narrowest when none does.
Tiling ChooseTiling(int width_px, int height_px, int bits_per_sample, const Options& options,
                    std::uint64_t budget_bytes);

/// Detects up to `max_features` keypoints, sorted by (y, x, scale, angle). Deterministic: the same bytes for every
/// tiling, number of threads and processor level (RILIEVO_KERNELS forces one). Images without texture, or too small for
/// a single feature, give none. Cost of SIFT about 0.06 s a megapixel on one core, with GLOH 0.07, with
/// PCA-SIFT 0.08; of SURF a third.
ImageFeatures Run(const Input& input, const Options& options, RunContext& context);

}  // namespace rilievo::features
