// The kernels of SIFT, one table a processor level: filters, extrema, orientation, descriptor.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "stages/features/scale_space.h"

namespace rilievo::features {

/// Rows that go through a filter together.
inline constexpr int kBlockRows = 8;
/// Columns that a kernel may write beyond the end of what it was asked for.
inline constexpr int kOvershoot_px = 64;
/// Half width of the filter that doubles the image and brings it to the base blur, in pixels of the image.
inline constexpr int kUpsampleRadius_px = 4;
inline constexpr int kUpsampleTaps = 2 * kUpsampleRadius_px;

/// Half width of the first blur when the image is not doubled; one of kBlurRadius_px.
inline constexpr int kFirstBlurRadius_px = 6;

/// Layers hold grey levels in 1/256 of an 8-bit level.
inline constexpr float kUnitsPerLevel = 256.0F;

/// One block of a separable filter with the weights w[0..2r]: out[j][x] = sum over rows and columns, vertical first.
struct BlurBlock {
  int radius = 0;
  const float* weights = nullptr;
  const std::uint16_t* in[kBlockRows + 2 * 12 + 1];  ///< kBlockRows + 2 radius rows, x counted from the same column
  std::uint16_t* out[kBlockRows];
  int begin = 0, end = 0;    ///< columns of out; columns [begin - radius, end + radius) of in are read
  float* scratch = nullptr;  ///< 4 rows of scratch_stride floats
  std::size_t scratch_stride = 0;
};

/// Two output rows of the doubled image around source row m: phase -1/4 and +1/4 of a source pixel.
struct UpsampleBlock {
  const float* in[kUpsampleTaps + 1];  ///< source rows m - 4 .. m + 4, grey levels, x counted from the same column
  std::uint16_t* out[2];               ///< rows 2m and 2m + 1
  int begin = 0, end = 0;              ///< columns of the source; columns 2 begin .. 2 end of out are written
  const float* weights = nullptr;      ///< kUpsampleTaps + 1 weights of phase -1/4; phase +1/4 is its mirror image
  float gain = 1;                      ///< layer units a source unit
  float* scratch = nullptr;
  std::size_t scratch_stride = 0;
};

/// Rows to search: for 5 differences, rows -1 .. kBlockRows of 6 layers.
struct SearchBlock {
  const std::uint16_t* layers[kLayers][kBlockRows + 2];
  int begin = 0, end = 0;           ///< columns
  std::int16_t threshold = 0;       ///< least |difference| in layer units
  std::int16_t* scratch = nullptr;  ///< kSearchScratchRows rows of scratch_stride
  std::size_t scratch_stride = 0;
};
inline constexpr int kSearchScratchRows = 45;

/// A sample that is not smaller than its 26 neighbours, or not larger.
struct Candidate {
  std::int16_t row = 0;    ///< in the block
  std::int16_t scale = 0;  ///< 1..3
  std::int32_t column = 0;
};

/// A layer kept as a ring of rows: pixel (x, y) at data[(y & row_mask) * stride + x].
struct RingView {
  const std::uint16_t* data = nullptr;
  int row_mask = 0;
  int stride = 0;
};

struct Patch {
  RingView layer;
  float x = 0, y = 0;  ///< sample coordinates in the layer: integers are pixel centres
  float sigma_px = 0;
};

inline constexpr int kMaxOrientations = 8;
struct Orientations {
  int count = 0;
  float turns[kMaxOrientations];  ///< in [0, 1), from +x towards +y; strongest bin first is NOT implied
};

/// Where a patch is sampled: offsets along the feature's direction and across it, in steps of kSampleStep_sigma. Arrays
/// are padded to a multiple of 64.
struct SampleGrid {
  const float* u = nullptr;
  const float* v = nullptr;
  int count = 0;
};

struct SiftKernels {
  std::string_view name;
  void (*upsample)(const UpsampleBlock&) = nullptr;
  void (*blur)(const BlurBlock&) = nullptr;
  /// Writes candidates in the order of rows, columns, scales; returns their number, at most `capacity`.
  std::size_t (*search)(const SearchBlock&, Candidate* found, std::size_t capacity) = nullptr;
  Orientations (*orient)(const Patch&) = nullptr;
  /// 128 floats, not normalised: [cell row][cell column][orientation].
  void (*describe)(const Patch&, float cosine, float sine, float* histogram) = nullptr;
  /// The layer, bilinearly, at the points of a grid turned by the angle; kOvershoot_px more floats may be written.
  void (*sample)(const Patch&, const SampleGrid&, float cosine, float sine, float* values) = nullptr;
  /// What `describe` bins: magnitude and direction in turns of the central differences at the kPatchSide^2 samples,
  /// each kGradientFloats long. Those of the border are not set.
  void (*gradients)(const Patch&, float cosine, float sine, float* magnitude, float* turns) = nullptr;
  /// out = a b, row-major: a has `rows` x `inner`, b `inner` x `columns`; each value is the sum of rounded products in
  /// ascending order. rows % 4 == 0 and columns % 16 == 0, or one row and columns % 64 == 0.
  void (*multiply)(const float* a, int rows, int inner, const float* b, int columns, float* out) = nullptr;
  bool is_supported = true;  ///< by this processor
};

/// scalar, avx2, avx512, whether this processor has them or not.
std::span<const SiftKernels> AllSiftKernels();
/// The kernels of that name, or the widest supported ones when it is empty. Throws Error(kUsage) as ChooseKernel does.
const SiftKernels& ChooseSiftKernels(std::string_view name);

extern const SiftKernels kSiftScalar, kSiftAvx2, kSiftAvx512;

/// Constant tables, the same for all levels (sift_tables.cc). Lists of samples are padded to vectors.
inline constexpr int kGradientFloats = (kPatchSide * kPatchSide + 63) / 64 * 64 + kOvershoot_px;
inline constexpr int kPaddedPatch = (kPatchSide * kPatchSide + 63) / 64 * 64;
inline constexpr int kPaddedOrientation = (kOrientationSide * kOrientationSide + 63) / 64 * 64;
struct SiftTables {
  alignas(64) float patch_u[kPaddedPatch] = {}, patch_v[kPaddedPatch] = {};  ///< sample offsets in steps
  alignas(64) float orientation_u[kPaddedOrientation] = {}, orientation_v[kPaddedOrientation] = {};
  alignas(64) float orientation_weights[kPaddedOrientation] = {};  ///< zero outside the circle
  /// Weights of a sample in 2 neighbouring cell rows x 4 cell columns: Gaussian of 2 cells x bilinear.
  alignas(64) float cell_weights[kPatchSide * kPatchSide][8] = {};
  alignas(64) float blur_weights[kBlurs][2 * 12 + 1] = {};
  float upsample_weights[kUpsampleTaps + 1] = {};              ///< phase -1/4
  float first_blur_weights[2 * kFirstBlurRadius_px + 1] = {};  ///< from the camera's blur to the base's, first octave 0
};
const SiftTables& Tables();

}  // namespace rilievo::features
