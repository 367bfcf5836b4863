// The kernels of two-view geometry, one table a processor level: five-point solver, residuals, sums of refinements.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

namespace rilievo {

/// Pairs of points that are scored together.
inline constexpr int kPairBlock = 64;
/// Samples that the five-point solver works on together.
inline constexpr int kFivePointBatch = 8;
inline constexpr int kFivePointMost = 10 * kFivePointBatch;

/// Coordinates (x, y) = (X/Z, Y/Z) of five pairs: rows 0-4 x of the first image, 5-9 y, 10-14 x of the second, 15-19 y.
struct FivePointSamples {
  alignas(64) double rows[20][kFivePointBatch];
};

/// Essential matrices of Frobenius norm 1, row-major, in the order of samples and of the polynomial's roots.
struct FivePointModels {
  int size = 0;
  std::int32_t sample[kFivePointMost];
  double matrices[kFivePointMost][9];
};

/// kPairBlock pairs in single precision.
struct PairBlock {
  const float *x1, *y1, *x2, *y2;
};

/// Any number of pairs in double precision; the arrays are readable up to the next multiple of eight.
struct PairColumns {
  const double *x1, *y1, *x2, *y2;
  int size;
};

/// Sum of min(r^2 / limit, 1) and number of r^2 <= limit of a block.
struct BlockScore {
  float cost = 0;
  int inliers = 0;
};

/// Sums of a least-squares problem in the nine entries of a matrix: of r^2, of r g, of g g' (upper triangle by rows),
/// g = dr / dmatrix (row-major).
struct MatrixSums {
  double squares;
  double right[9];
  double normal[45];
};

/// Sums of the transfer x_second = H x_first, u = H x_first, w its third coordinate, p = u / w, d = p - x_second:
/// of d'd, of (d_x, d_y, -p'd) (x) x / w, and of (1, p_x, p_y, p'p) (x) upper triangle of x x' / w^2. Points with
/// w <= 0 count in `behind` only.
struct TransferSums {
  double squares, behind;
  double right[9];
  double normal[24];
};

struct TwoViewKernels {
  std::string_view name;
  /// All real solutions of each sample.
  void (*five_point)(const FivePointSamples&, FivePointModels&) = nullptr;
  /// Only those that put a sample's five points on the same side of the cameras (five_point.h).
  void (*five_point_oriented)(const FivePointSamples&, FivePointModels&) = nullptr;
  /// r^2 of each pair; matrix row-major, v1, v2 the variances of a coordinate.
  void (*sampson)(const float* matrix, float v1, float v2, const PairBlock&, float* squared) = nullptr;
  void (*both_distances)(const float* matrix, float v1, float v2, const PairBlock&, float* squared) = nullptr;
  /// Mean of both transfers; 1e30 beyond the horizon.
  void (*transfer)(const float* matrix, const float* inverse, float v1, float v2, const PairBlock&,
                   float* squared) = nullptr;
  BlockScore (*truncate)(const float* squared, int count, float limit) = nullptr;
  void (*sampson_sums)(const double* matrix, double v1, double v2, const PairColumns&, MatrixSums&) = nullptr;
  void (*transfer_sums)(const double* matrix, const PairColumns&, TransferSums&) = nullptr;
  bool is_supported = true;  ///< by this processor
};

/// scalar, avx2, avx512, whether this processor has them or not; all give the same bytes.
std::span<const TwoViewKernels> AllTwoViewKernels();
/// The kernels of that name, or the widest supported ones when it is empty. Throws Error(kUsage) as ChooseKernels does.
const TwoViewKernels& ChooseTwoViewKernels(std::string_view name);
/// Those of RILIEVO_KERNELS.
const TwoViewKernels& ActiveTwoViewKernels();

extern const TwoViewKernels kTwoViewScalar, kTwoViewAvx2, kTwoViewAvx512;

}  // namespace rilievo
