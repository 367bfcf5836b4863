// The camera's point spread function on a grid of sub-samples.
#pragma once

#include <vector>

namespace rilievo::simulation {

/// Weights of the sub-samples that make a pixel's value, along one axis: the pixel's box convolved with a Gaussian of
/// `sigma_px`, at offsets (k + 0.5) / samples - Radius px from the pixel's centre, k = 0.. ; they sum to 1.
struct Psf {
  Psf(double sigma_px, int samples);
  int radius_px = 1;        ///< pixels to either side of the pixel's own that take part; at most 16
  std::vector<float> taps;  ///< (2 * radius_px + 1) * samples
};

}  // namespace rilievo::simulation
