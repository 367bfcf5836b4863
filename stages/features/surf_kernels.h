// The kernels of SURF, one table a processor level: integral image, Hessian, extrema, Haar wavelets.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

namespace rilievo::features {

namespace surf {

/// Elements that a kernel may write or read beyond the end of a row.
inline constexpr int kOvershoot = 64;

/// One row of det H of one filter at neighbouring pixels. Row pointers are of the integral image, at the column of the
/// left edge of the first pixel; rows by their distance from the upper edge of the centre row, l = lobe:
/// 0, 1: -(l-1), l;  2..5: -(3l-1)/2, -(l-1)/2, (l+1)/2, (3l+1)/2;  6..9: -l, 0, 1, l+1.
struct HessianRow {
  const std::int32_t* rows[10];
  int count = 0;           ///< pixels
  int lobe = 0;            ///< l
  float inverse_area = 0;  ///< of the filter, grey levels included
  float* out;              ///< `count` values; kOvershoot more may be written
};

/// Rows -1, 0, 1 of three neighbouring layers of det H, first sample at [0]; sample -1 and `count` are read.
struct ExtremaRow {
  const float* layers[3][3];
  int count = 0;
  float threshold = 0;
};

/// The integral image: the sum of the pixels above boundary y and left of boundary x, modulo 2^32, is
/// data[(y & row_mask) * stride + x - origin_x].
struct IntegralView {
  const std::int32_t* data = nullptr;
  int row_mask = 0, stride = 0, origin_x = 0;
};

inline constexpr int kCircleSamples = 113, kPaddedCircle = 128;  ///< integer points within a radius of 6
inline constexpr int kBins = 72;                                 ///< of 5 degrees
/// See BinOf.
inline constexpr float kAtan[5] = {46930.0F / 4096, -15503.0F / 4096, 8455.0F / 4096, -3996.0F / 4096, 978.0F / 4096};
inline constexpr int kCells = 16, kCellSamples = 25, kComponents = 8;

/// Gaussian-weighted Haar responses in x and y and the bin of their direction.
struct CircleResponses {
  float x[kPaddedCircle], y[kPaddedCircle];
  std::int32_t bin[kPaddedCircle];
};

struct Window {
  IntegralView integral;
  float x_px = 0, y_px = 0, scale_px = 0, cosine = 1, sine = 0;
};

/// Where samples lie, in units of the scale, and what they weigh (surf_tables.cc).
struct Tables {
  alignas(64) float circle_u[kPaddedCircle] = {}, circle_v[kPaddedCircle] = {}, circle_weight[kPaddedCircle] = {};
  /// [sample of a cell][cell]: cells lie in the lanes, so that sums need no reduction across lanes.
  alignas(64) float grid_u[kCellSamples][kCells] = {}, grid_v[kCellSamples][kCells] = {},
                    grid_weight[kCellSamples][kCells] = {};
};
const Tables& SurfTables();

}  // namespace surf

struct SurfKernels {
  std::string_view name;
  /// below[i + 1] = above[i + 1] + p[0] + .. + p[i], below[0] = above[0], where p[i] is line[i .. i + 4] under the
  /// binomial weights 1 4 6 4 1, shifted right by `shift`, rounded.
  void (*integrate)(const std::uint16_t* line, int count, int shift, const std::int32_t* above,
                    std::int32_t* below) = nullptr;
  void (*hessian)(const surf::HessianRow&) = nullptr;
  /// Samples above the threshold that exceed their 26 neighbours (equal ones: the first in the order of layers, rows,
  /// columns wins). Writes their columns in ascending order, returns how many.
  int (*extrema)(const surf::ExtremaRow&, std::int32_t* columns) = nullptr;
  void (*circle)(const surf::Window&, const surf::Tables&, surf::CircleResponses*) = nullptr;
  /// sums[component][cell], components: sum dx and |dx| where dy < 0, the same where dy >= 0, sum dy and |dy| where
  /// dx < 0, the same where dx >= 0.
  void (*describe)(const surf::Window&, const surf::Tables&, float (*sums)[surf::kCells]) = nullptr;
  bool is_supported = true;
};

extern const SurfKernels kSurfScalar, kSurfAvx2, kSurfAvx512;

std::span<const SurfKernels> AllSurfKernels();
/// The kernels of that name, or the widest supported ones when it is empty. Throws Error(kUsage) for an unknown name or
/// one that this processor lacks.
const SurfKernels& ChooseSurfKernels(std::string_view name);

}  // namespace rilievo::features
