// SIFT keypoints and descriptors of one image.
#pragma once

#include <span>

#include "base/option.h"
#include "base/run_context.h"
#include "base/task_cost.h"
#include "block/features.h"
#include "block/pixels.h"

namespace rilievo::features {

struct Options {
  int max_features = 16384;
  double contrast_threshold = 0.02;
  double edge_threshold = 10.0;
  bool root_sift = true;
};

std::span<const OptionDeclaration<Options>> OptionDeclarations();

/// Bumped whenever Run's result changes for equal input: part of the artifact key.
inline constexpr int kVersion = 1;

/// `mask`: empty = every pixel is usable; else a byte a pixel, row by row, 128 and more = usable. A feature is kept
/// when the pixel under it is usable.
struct Input {
  const GreyImage& image;
  std::span<const std::uint8_t> mask;
};

/// Bytes a pixel that a mask adds to Estimate: itself, and the descriptors of what it or the cut removes (a few
/// hundredths of a feature a pixel), which OpenCV computes for all.
inline constexpr std::uint64_t kMaskBytesPerPixel = 1 + 8;

/// Upper bound of the memory Run holds for an image of this size (its own pixels included).
TaskCost Estimate(int width_px, int height_px, const Options& options);

/// Detects up to `max_features` usable keypoints (the strongest; ties by position), sorted by (y, x, scale, angle).
/// Deterministic. Cost about 0.25 s a megapixel on one core.
ImageFeatures Run(const Input& input, const Options& options, RunContext& context);

}  // namespace rilievo::features
