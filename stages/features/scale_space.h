// The Gaussian scale space of SIFT as constants: scales, filters, and the halo of pixels that each step needs.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace rilievo::features {

/// Lowe 2004: an octave starts at sigma 1.6 (in its own pixels); three scales an octave need six Gaussian layers and
/// five differences, of which the three inner ones are searched.
inline constexpr int kScales = 3, kLayers = kScales + 3, kBlurs = kLayers - 1;
inline constexpr double kBaseSigma = 1.6;
/// Blur that a photograph is assumed to have, in its pixels.
inline constexpr double kCameraSigma = 0.5;

/// The doubled image is blurred to more than that: to the width of one pixel of the image, sigma 2 in its own pixels.
/// Lowe 2004 and the programs after him have 1.82 there, because they do not count what the linear doubling blurs.
/// Noise and the pixel grid disturb the finest features less for it. The surplus fades from octave to octave.
inline constexpr double kDoubledSigma = 2.0;
/// Surplus of variance over 1.6^2 in the octave of that index, in its pixels squared, when the first one is doubled.
inline constexpr double SurplusVariance_px2(int octave) {
  double surplus = kDoubledSigma * kDoubledSigma - kBaseSigma * kBaseSigma;
  for (int o = -1; o < octave; ++o) surplus /= 4;
  return surplus;
}

/// Blur of a layer (a fraction between two) in pixels of its octave: sqrt(1.6^2 4^(layer / 3) + surplus).
double LayerSigma(double layer, double surplus_px2);

/// Half widths of the filters from layer i to i + 1, 4 sigma: sigma_i = 1.6 sqrt(4^((i+1)/3) - 4^(i/3)).
inline constexpr std::array<int, kBlurs> kBlurRadius_px = {5, 6, 8, 10, 12};
/// Rows by which layer i lags behind layer 0 when rows stream through the filters: the sum of the half widths before.
inline constexpr std::array<int, kLayers> kLag_px = [] {
  std::array<int, kLayers> lag{};
  for (std::size_t i = 1; i < lag.size(); ++i) lag[i] = lag[i - 1] + kBlurRadius_px[i - 1];
  return lag;
}();

/// An extremum is looked for with its neighbours (1 px) and may move while it is located.
inline constexpr int kMaxMove_px = 2;
inline constexpr int kSearchReach_px = kMaxMove_px + 1;
/// No feature nearer to the border of its octave: there the layers show the mirror image.
inline constexpr int kBorder_px = 5;

/// Largest scale of a feature in the pixels of its octave: layer 3 and half a step, with the largest surplus.
inline constexpr double kLargestScale_px = 3.8;
static_assert(kLargestScale_px * kLargestScale_px >=
              kBaseSigma * kBaseSigma * 5.0396841995794928 + SurplusVariance_px2(-1));  // 4^(3.5/3)

/// Descriptor: 4 x 4 cells of 3 sigma each (Lowe 2004; Vedaldi & Fulkerson 2008), kCellSamples samples a cell and axis,
/// half a cell more on each side for the bilinear weights, one sample more for the differences.
inline constexpr int kCells = 4, kCellSamples = 4, kOrientationBins = 8;
inline constexpr double kCellWidth_sigma = 3.0, kSampleStep_sigma = kCellWidth_sigma / kCellSamples;
inline constexpr int kPatchSide = (kCells + 1) * kCellSamples + 2;
/// Orientation: samples of the same step within 4.5 sigma, weighted by a Gaussian of 1.5 sigma (Lowe 2004).
inline constexpr double kOrientationRadius_sigma = 4.5, kOrientationWeight_sigma = 1.5;
inline constexpr int kOrientationSide = 2 * static_cast<int>(kOrientationRadius_sigma / kSampleStep_sigma) + 3;
static_assert(kOrientationSide < kPatchSide);
/// From the feature's pixel: half the patch's diagonal, the move while locating, half a pixel to the sub-pixel position
/// and one for the bilinear interpolation.
inline constexpr int kDescriptorReach_px =
    static_cast<int>(0.5 * (kPatchSide - 1) * kSampleStep_sigma * kLargestScale_px * 1.4142136) + 1 + kMaxMove_px + 2;

/// Halos to the sides of a strip: layer i is needed this far beyond it, for the features whose centres the strip owns.
inline constexpr std::array<int, kLayers> kHalo_px = [] {
  std::array<int, kLayers> halo{};
  halo[kLayers - 1] = kSearchReach_px;
  for (std::size_t i = kLayers - 1; i-- > 0;) {
    halo[i] = halo[i + 1] + kBlurRadius_px[i];
    const bool is_described = i >= 1 && i <= static_cast<std::size_t>(kScales);
    if (is_described && halo[i] < kDescriptorReach_px) halo[i] = kDescriptorReach_px;
  }
  return halo;
}();

/// Rows by which the search and the description lag behind layer 0: all that they look at exists by then.
inline constexpr int kSearchLag_px = kLag_px[kLayers - 1] + kSearchReach_px;
inline constexpr int kDescribeLag_px = kLag_px[kScales] + kDescriptorReach_px;

/// First and last rows and columns that exist beyond an octave: mirrored at half a sample (c b a | a b c).
inline constexpr int Mirror(int i, int size) {
  const int period = 2 * size;
  i %= period;
  if (i < 0) i += period;
  return i < size ? i : period - 1 - i;
}

}  // namespace rilievo::features
