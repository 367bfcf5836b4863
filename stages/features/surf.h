// SURF keypoints and descriptors of one image (Bay, Ess, Tuytelaars & Van Gool 2008).
#pragma once

#include <cstdint>
#include <vector>

#include "base/run_context.h"
#include "stages/features/feature.h"

namespace rilievo::features {

struct SurfOptions {
  /// Least det H. Second derivatives are box sums over the area of the filter, in grey levels of 255, so that det H is
  /// in squared grey levels and does not depend on the bits of the image.
  double hessian_threshold = 8.0;
  int elements = 128;    ///< 64 or 128
  bool upright = false;  ///< U-SURF: no orientation, angle 0
};

struct SurfKernels;

/// The image is smoothed first (binomial 1 4 6 4 1, sigma 1 px): edges of boxes lie at whole pixels, and on a sharp
/// image the sign of a Haar response of 4 px depends on where they fall. On the first pairs of Oxford's
/// graf and boat this gives 1.1 to 1.7 times the correct matches at the same number of features (wider pairs are
/// mixed); the paper's integral image is that of the bare image.
///
/// All features whose det H exceeds the threshold, in an order that only depends on the tiling (sort them); the set
/// itself, to the last bit, depends on neither tiling nor kernels. Position and scale are interpolated; scale_px = 1.2
/// size / 9 of the box filter; sign +1 for bright, -1 for dark blobs; covariance zero (not known). Descriptor bytes:
/// docs/decisions/0010. A feature's filter and its neighbours lie inside the image, so that margins of 11 px (finest
/// layer) to 106 px (coarsest) have no features; descriptors near the border see the image reflected (half-sample).
/// Cost about a sixteenth of OpenCV's SIFT at 1800 features a megapixel (AVX2); memory SurfPeakBytes beside the result.
/// Strips of 1024 px are some 15 % faster than of 512: the halo is 386 px on either side.
std::vector<Feature> DetectSurf(const Input& input, const SurfOptions& options, const Tiling& tiling,
                                RunContext& context);

/// The same by the given kernels.
std::vector<Feature> DetectSurf(const Input& input, const SurfOptions& options, const Tiling& tiling,
                                RunContext& context, const SurfKernels& kernels);

/// Bytes of the workspaces of DetectSurf.
std::uint64_t SurfPeakBytes(int width_px, const Tiling& tiling);

}  // namespace rilievo::features
