// FAST corners of one image (Rosten & Drummond 2006), as even over the image as its texture allows.
#pragma once

#include <cstdint>
#include <vector>

#include "base/run_context.h"
#include "stages/features/feature.h"

namespace rilievo::features {

struct FastOptions {
  int arc = 9;                  ///< neighbours in a row that must differ: 9 or 12 of 16
  int corners = 4000;           ///< aimed at in the whole image; every cell of 64 px has its share by area
  double min_threshold = 6.0;   ///< least contrast of a corner, grey levels of 255
  double min_roundness = 0.5;   ///< least Foerstner roundness q; 0 keeps all
  int roundness_window_px = 7;  ///< odd; side of the window of q
};

struct Corner {
  float x_px = 0, y_px = 0;  ///< centre of a pixel
  float score = 0;           ///< largest threshold at which it still is a corner, grey levels of 255
  float roundness = 0;       ///< q = 4 det N / tr^2 N in [0, 1] over the window, N from central differences
  friend bool operator==(const Corner&, const Corner&) = default;
};

struct FastKernels;

/// Sorted by (y, x). A corner: `arc` contiguous pixels of the circle of radius 3 are all brighter than the centre by
/// more than the threshold, or all darker. It has the largest score of its 3 x 3 neighbours (equal ones: the first in
/// reading order), q >= min_roundness, and its score reaches the threshold of its cell: the largest with which the cell
/// has its share of such corners, but not less than min_threshold. (Corners of equal score stay together, so that a
/// cell may have a few more.) Cells begin at the first pixel and have nothing to do with the tiling, on which not one
/// byte depends, nor on the kernels. 16-bit images keep 15 bits. Pixels where the mask is below 128 have no corners.
std::vector<Corner> DetectFast(const Input& input, const FastOptions& options, const Tiling& tiling,
                               RunContext& context);

/// The same by the given kernels.
std::vector<Corner> DetectFast(const Input& input, const FastOptions& options, const Tiling& tiling,
                               RunContext& context, const FastKernels& kernels);

inline constexpr int kFastCell_px = 64;

}  // namespace rilievo::features
