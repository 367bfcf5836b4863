// The box filters of SURF, their octaves, and what they need around a sample.
#pragma once

#include <cstddef>

namespace rilievo::features::surf {

/// Side of a filter (three lobes) and how its samples are spaced: every 2^shift px, the finest octave that uses it.
struct Filter {
  int size_px, shift;
  constexpr int Lobe() const { return size_px / 3; }
  constexpr int Reach() const { return size_px / 2; }  ///< pixels on either side of the centre pixel
};

inline constexpr int kFilters = 10, kOctaves = 4, kLayers = 4;
inline constexpr Filter kFilter[kFilters] = {{9, 0},  {15, 0}, {21, 0}, {27, 0},  {39, 1},
                                             {51, 1}, {75, 2}, {99, 2}, {147, 3}, {195, 3}};
/// Octave o samples every 2^o px. Layers 1 and 2 are searched, 0 and 3 are their neighbours in scale.
inline constexpr int kOctave[kOctaves][kLayers] = {{0, 1, 2, 3}, {1, 3, 4, 5}, {3, 5, 6, 7}, {5, 7, 8, 9}};

/// Interpolated extrema may lie this many samples or layers from the discrete one, as in the author's practice.
inline constexpr double kLargestOffset = 1.0;
/// Scale of a filter of one pixel: the 9 x 9 filter stands for a Gaussian of 1.2 px.
inline constexpr double kScalePerSize = 1.2 / 9;

constexpr double LargestScale_px() {
  double largest = 0;
  for (const auto& layers : kOctave) {
    const double middle = kFilter[layers[2]].size_px, next = kFilter[layers[3]].size_px;
    const double scale_px = kScalePerSize * (middle + kLargestOffset * (next - middle));
    if (scale_px > largest) largest = scale_px;
  }
  return largest;
}

/// How far from the discrete sample of a feature its descriptor reads the integral image: the interpolated position,
/// the outermost sample of the rotated grid (9.5 s, 9.5 s), its Haar wavelet of half width round(s), and the rounding
/// of the sample's position. The orientation needs less (6 s + round(2 s)), the filters too.
constexpr int Reach_px() {
  const double s = LargestScale_px();
  const double reach_px = kLargestOffset * (1 << (kOctaves - 1)) + 9.5 * 1.41422 * s + (s + 0.5) + 0.5;
  return static_cast<int>(reach_px) + 2;
}
inline constexpr int kReach_px = Reach_px();
static_assert(kReach_px > kFilter[kFilters - 1].Reach() + 2 * (1 << (kOctaves - 1)));
static_assert(kReach_px > 8 * LargestScale_px() + 2 + kLargestOffset * (1 << (kOctaves - 1)));

/// Rows of the integral image that are alive at once: a power of two.
constexpr int RingRows() {
  int rows = 1;
  while (rows < 2 * kReach_px + 4 * (1 << (kOctaves - 1))) rows *= 2;
  return rows;
}
inline constexpr int kRingRows = RingRows();

}  // namespace rilievo::features::surf
