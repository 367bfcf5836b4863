// The kernels of SIFT written once, over the lanes of a processor level (base/lanes_*.h). Lanes never mix, so that all
// levels give the same bits. Included by sift_kernels_{scalar,avx2,avx512}.cc only.
#pragma once

#include <bit>
#include <cstring>

#include "stages/features/sift_kernels.h"

namespace rilievo::features {

// ---- filters --------------------------------------------------------------------------------------------------------

/// Vertical sums of 4 rows into scratch, columns [begin, end).
template <class L, int R>
void BlurVertical(const std::uint16_t* const* in, const float* weights, float* scratch, std::size_t stride, int begin,
                  int end) {
  using F = typename L::F;
  constexpr int kTaps = 2 * R + 1;
  for (int x = begin; x < end; x += 2 * L::kWidth) {
    F sum[4][2];
#pragma GCC unroll 32
    for (int k = 0; k < kTaps + 3; ++k) {
      const F a = L::LoadU16(in[k] + x), b = L::LoadU16(in[k] + x + L::kWidth);
#pragma GCC unroll 4
      for (int j = 0; j < 4; ++j) {
        const int t = k - j;
        if (t < 0 || t >= kTaps) continue;
        const F w = L::Set(weights[t]);
        sum[j][0] = t == 0 ? w * a : L::Fma(w, a, sum[j][0]);
        sum[j][1] = t == 0 ? w * b : L::Fma(w, b, sum[j][1]);
      }
    }
#pragma GCC unroll 4
    for (int j = 0; j < 4; ++j) {
      L::Store(scratch + static_cast<std::size_t>(j) * stride + x, sum[j][0]);
      L::Store(scratch + static_cast<std::size_t>(j) * stride + x + L::kWidth, sum[j][1]);
    }
  }
}

template <class L, int R>
void BlurHorizontal(const float* scratch, std::size_t stride, const float* weights, std::uint16_t* const* out,
                    int begin, int end) {
  using F = typename L::F;
  constexpr int kTaps = 2 * R + 1;
  for (int x = begin; x < end; x += 2 * L::kWidth) {
    F sum[4][2];
#pragma GCC unroll 32
    for (int t = 0; t < kTaps; ++t) {
      const F w = L::Set(weights[t]);
#pragma GCC unroll 4
      for (int j = 0; j < 4; ++j) {
        const float* row = scratch + static_cast<std::size_t>(j) * stride + x + (t - R);
        const F a = L::Load(row), b = L::Load(row + L::kWidth);
        sum[j][0] = t == 0 ? w * a : L::Fma(w, a, sum[j][0]);
        sum[j][1] = t == 0 ? w * b : L::Fma(w, b, sum[j][1]);
      }
    }
#pragma GCC unroll 4
    for (int j = 0; j < 4; ++j) {
      L::StoreU16(out[j] + x, sum[j][0]);
      L::StoreU16(out[j] + x + L::kWidth, sum[j][1]);
    }
  }
}

template <class L, int R>
void BlurRows(const BlurBlock& block) {
  for (int half = 0; half < kBlockRows; half += 4) {
    BlurVertical<L, R>(block.in + half, block.weights, block.scratch, block.scratch_stride, block.begin - R,
                       block.end + R);
    BlurHorizontal<L, R>(block.scratch, block.scratch_stride, block.weights, block.out + half, block.begin, block.end);
  }
}

template <class L>
void Blur(const BlurBlock& block) {
  static_assert(kBlurRadius_px[0] == 5 && kBlurRadius_px[1] == 6 && kBlurRadius_px[2] == 8 && kBlurRadius_px[3] == 10 &&
                kBlurRadius_px[4] == 12);
  switch (block.radius) {
    case 5:
      return BlurRows<L, 5>(block);
    case 6:
      return BlurRows<L, 6>(block);
    case 8:
      return BlurRows<L, 8>(block);
    case 10:
      return BlurRows<L, 10>(block);
    default:
      return BlurRows<L, 12>(block);
  }
}

/// Doubling and first blur in one filter: phase +1/4 uses the weights backwards. Interleaving does not saturate: values
/// are kept in range here.
template <class L>
void Upsample(const UpsampleBlock& block) {
  using F = typename L::F;
  constexpr int kTaps = kUpsampleTaps + 1, R = kUpsampleRadius_px;
  float* upper = block.scratch;
  float* lower = block.scratch + block.scratch_stride;
  for (int x = block.begin - R; x < block.end + R; x += L::kWidth) {
    F a = L::Set(0.0F), b = L::Set(0.0F);
#pragma GCC unroll 9
    for (int t = 0; t < kTaps; ++t) {
      const F v = L::Load(block.in[t] + x);
      a = L::Fma(L::Set(block.weights[t]), v, a);
      b = L::Fma(L::Set(block.weights[kTaps - 1 - t]), v, b);
    }
    L::Store(upper + x, a * L::Set(block.gain));
    L::Store(lower + x, b * L::Set(block.gain));
  }
  const F black = L::Set(0.0F), white = L::Set(65535.0F);
  for (int row = 0; row < 2; ++row) {
    const float* in = row == 0 ? upper : lower;
    for (int x = block.begin; x < block.end; x += L::kWidth) {
      F even = L::Set(0.0F), odd = L::Set(0.0F);
#pragma GCC unroll 9
      for (int t = 0; t < kTaps; ++t) {
        const F v = L::Load(in + x + (t - R));
        even = L::Fma(L::Set(block.weights[t]), v, even);
        odd = L::Fma(L::Set(block.weights[kTaps - 1 - t]), v, odd);
      }
      L::StoreU16Interleaved(block.out[row] + 2 * x, L::Min(L::Max(even, black), white),
                             L::Min(L::Max(odd, black), white));
    }
  }
}

// ---- extrema --------------------------------------------------------------------------------------------------------

/// Rows of one difference: three of each kind, used in turn.
struct DifferenceRows {
  std::int16_t *value[3], *largest[3], *smallest[3];
};

template <class L>
void Difference(const std::uint16_t* lower, const std::uint16_t* upper, const DifferenceRows& rows, int slot, int begin,
                int end) {
  std::int16_t* value = rows.value[slot];
  for (int x = begin - L::kShorts; x < end + L::kShorts; x += L::kShorts)
    L::StoreShorts(value + x, L::SubShorts(L::LoadShorts(upper + x), L::LoadShorts(lower + x)));
  for (int x = begin; x < end; x += L::kShorts) {
    const auto left = L::LoadShorts(value + x - 1), middle = L::LoadShorts(value + x),
               right = L::LoadShorts(value + x + 1);
    L::StoreShorts(rows.largest[slot] + x, L::MaxShorts(L::MaxShorts(left, right), middle));
    L::StoreShorts(rows.smallest[slot] + x, L::MinShorts(L::MinShorts(left, right), middle));
  }
}

/// Bits of `candidates` whose value no neighbour exceeds (kLargest) or undercuts. The own scale is asked first: it
/// rules out most.
template <class L, bool kLargest>
std::uint32_t KeepExtrema(std::uint32_t candidates, typename L::S value, const DifferenceRows* differences, int scale,
                          int x) {
  for (const int d : {scale, scale - 1, scale + 1}) {
    const auto& rows = kLargest ? differences[d].largest : differences[d].smallest;
    const auto a = L::LoadShorts(rows[0] + x), b = L::LoadShorts(rows[1] + x), c = L::LoadShorts(rows[2] + x);
    if constexpr (kLargest)
      candidates &= ~L::GreaterShorts(L::MaxShorts(L::MaxShorts(a, b), c), value);
    else
      candidates &= ~L::GreaterShorts(value, L::MinShorts(L::MinShorts(a, b), c));
    if (candidates == 0) return 0;
  }
  return candidates;
}

/// One bit a lane where the sample at column x, middle row, is an extremum of its 3 x 3 x 3 neighbourhood.
template <class L>
std::uint32_t ExtremumBits(const DifferenceRows* differences, int scale, int middle, int x, std::int16_t threshold) {
  const auto value = L::LoadShorts(differences[scale].value[middle] + x);
  const std::uint32_t bright = L::GreaterShorts(value, L::SetShorts(threshold));
  const std::uint32_t dark = L::GreaterShorts(L::SetShorts(static_cast<std::int16_t>(-threshold)), value);
  std::uint32_t found = 0;
  if (bright != 0) found |= KeepExtrema<L, true>(bright, value, differences, scale, x);
  if (dark != 0) found |= KeepExtrema<L, false>(dark, value, differences, scale, x);
  return found;
}

template <class L>
std::size_t Search(const SearchBlock& block, Candidate* found, std::size_t capacity) {
  constexpr int kDifferences = kLayers - 1;
  DifferenceRows differences[kDifferences];
  std::int16_t* next = block.scratch;
  for (auto& d : differences) {
    for (auto* group : {d.value, d.largest, d.smallest}) {
      for (int slot = 0; slot < 3; ++slot, next += block.scratch_stride) group[slot] = next;
    }
  }
  std::size_t count = 0;
  for (int row = 0; row < kBlockRows + 2; ++row) {
    for (int d = 0; d < kDifferences; ++d)
      Difference<L>(block.layers[d][row], block.layers[d + 1][row], differences[d], row % 3, block.begin, block.end);
    if (row < 2) continue;
    for (int x = block.begin; x < block.end; x += L::kShorts) {
      for (int scale = 1; scale <= kScales; ++scale) {
        std::uint32_t bits = ExtremumBits<L>(differences, scale, (row - 1) % 3, x, block.threshold);
        for (; bits != 0 && count < capacity; bits &= bits - 1) {
          const int column = x + std::countr_zero(bits);
          if (column >= block.end) break;
          found[count++] = {static_cast<std::int16_t>(row - 2), static_cast<std::int16_t>(scale), column};
        }
      }
    }
  }
  return count;
}

// ---- patches --------------------------------------------------------------------------------------------------------

/// Bilinear samples at (x, y) + step (u, v) turned by the given angle, rounded up to a multiple of 16 of them.
template <class L>
void SamplePatch(const Patch& patch, const float* u, const float* v, int count, float cosine, float sine, float step_px,
                 float* values) {
  using F = typename L::F;
  using I = typename L::I;
  const F along = L::Set(cosine * step_px), across = L::Set(sine * step_px), back = L::Set(-(sine * step_px));
  const I mask = L::Set(patch.layer.row_mask), stride = L::Set(patch.layer.stride), one = L::Set(1),
          low = L::Set(0xFFFF);
  for (int k = 0; k < count; k += L::kWidth) {
    const F pu = L::Load(u + k), pv = L::Load(v + k);
    const F x = L::Fma(along, pu, L::Fma(back, pv, L::Set(patch.x)));
    const F y = L::Fma(across, pu, L::Fma(along, pv, L::Set(patch.y)));
    const I column = L::Truncate(x), row = L::Truncate(y);
    const F fx = x - L::ToFloat(column), fy = y - L::ToFloat(row);
    const I above = L::GatherPairs(patch.layer.data, L::Add(L::Mul(L::And(row, mask), stride), column));
    const I below = L::GatherPairs(patch.layer.data, L::Add(L::Mul(L::And(L::Add(row, one), mask), stride), column));
    const F a = L::ToFloat(L::And(above, low)), b = L::ToFloat(L::ShiftRight16(above));
    const F c = L::ToFloat(L::And(below, low)), d = L::ToFloat(L::ShiftRight16(below));
    const F top = L::Fma(fx, b - a, a), bottom = L::Fma(fx, d - c, c);
    L::Store(values + k, L::Fma(fy, bottom - top, top));
  }
}

/// atan2(y, x) in turns, [0, 1]; error below 2e-6 turns (Abramowitz & Stegun 4.4.49); 0 for the zero vector.
template <class L>
typename L::F Turns(typename L::F x, typename L::F y) {
  using F = typename L::F;
  const F ax = L::Abs(x), ay = L::Abs(y);
  const F ratio = L::Min(ax, ay) / L::Max(L::Max(ax, ay), L::Set(1e-30F));
  const F square = ratio * ratio;
  constexpr float kTurn = 0.15915494F;  // 1 / (2 pi)
  F t = L::Set(0.0208351F * kTurn);
  t = L::Fma(t, square, L::Set(-0.0851330F * kTurn));
  t = L::Fma(t, square, L::Set(0.1801410F * kTurn));
  t = L::Fma(t, square, L::Set(-0.3302995F * kTurn));
  t = L::Fma(t, square, L::Set(0.9998660F * kTurn));
  t = t * ratio;
  t = L::Select(L::Less(ax, ay), L::Set(0.25F) - t, t);
  t = L::Select(L::Less(x, L::Set(0.0F)), L::Set(0.5F) - t, t);
  return L::Select(L::Less(y, L::Set(0.0F)), L::Set(1.0F) - t, t);
}

/// Magnitude and direction of the central differences of a patch `side` wide, at positions [begin, end).
template <class L>
void Gradients(const float* values, int side, int begin, int end, float* magnitude, float* turns) {
  for (int k = begin; k < end; k += L::kWidth) {
    const auto dx = L::Load(values + k + 1) - L::Load(values + k - 1);
    const auto dy = L::Load(values + k + side) - L::Load(values + k - side);
    L::Store(magnitude + k, L::Sqrt(L::Fma(dx, dx, dy * dy)));
    L::Store(turns + k, Turns<L>(dx, dy));
  }
}

inline constexpr int kOrientationSamples = kOrientationSide * kOrientationSide;

/// Circular [1 4 6 4 1] / 16.
inline void SmoothHistogram(const float* in, float* out, int bins) {
  for (int i = 0; i < bins; ++i) {
    const auto at = [&](int k) { return in[(i + k + bins) % bins]; };
    out[i] = (at(-2) + at(2)) * (1.0F / 16) + (at(-1) + at(1)) * (4.0F / 16) + at(0) * (6.0F / 16);
  }
}

template <class L>
Orientations Orient(const Patch& patch) {
  constexpr int kSide = kOrientationSide, kPadded = (kOrientationSamples + 63) / 64 * 64 + 64;
  const SiftTables& tables = Tables();
  alignas(64) float values[kPadded] = {}, magnitude[kPadded], turns[kPadded];
  SamplePatch<L>(patch, tables.orientation_u, tables.orientation_v, kOrientationSamples, 1.0F, 0.0F,
                 static_cast<float>(kSampleStep_sigma) * patch.sigma_px, values);
  Gradients<L>(values, kSide, kSide, kOrientationSamples - kSide, magnitude, turns);
  constexpr int kBins = 36;
  float histogram[kBins + 2] = {}, smooth[kBins];
  for (int k = kSide; k < kOrientationSamples - kSide; ++k) {
    const float weight = tables.orientation_weights[k];
    if (weight == 0) continue;
    const float position = turns[k] * kBins, share = magnitude[k] * weight;
    const int bin = static_cast<int>(position);
    const float upper = share * (position - static_cast<float>(bin));
    histogram[bin] += share - upper;  // two bins beyond the end: turns may be 1
    histogram[bin + 1] += upper;
  }
  histogram[0] += histogram[kBins];
  histogram[1] += histogram[kBins + 1];
  SmoothHistogram(histogram, smooth, kBins);
  float peak = 0;
  for (const float h : smooth) peak = h > peak ? h : peak;
  Orientations result;
  for (int i = 0; i < kBins && result.count < kMaxOrientations; ++i) {
    const float left = smooth[(i + kBins - 1) % kBins], right = smooth[(i + 1) % kBins], middle = smooth[i];
    if (!(middle > left && middle > right && middle >= 0.8F * peak)) continue;
    float turn = (static_cast<float>(i) + 0.5F * (left - right) / (left - 2 * middle + right)) * (1.0F / kBins);
    if (turn < 0) turn += 1;
    if (turn >= 1) turn -= 1;
    result.turns[result.count++] = turn;
  }
  return result;
}

template <class L>
void Sample(const Patch& patch, const SampleGrid& grid, float cosine, float sine, float* values) {
  SamplePatch<L>(patch, grid.u, grid.v, grid.count, cosine, sine,
                 static_cast<float>(kSampleStep_sigma) * patch.sigma_px, values);
}

template <class L>
void PatchGradients(const Patch& patch, float cosine, float sine, float* magnitude, float* turns) {
  constexpr int kSamples = kPatchSide * kPatchSide;
  alignas(64) float values[kGradientFloats] = {};
  Sample<L>(patch, {Tables().patch_u, Tables().patch_v, kSamples}, cosine, sine, values);
  Gradients<L>(values, kPatchSide, kPatchSide, kSamples - kPatchSide, magnitude, turns);
}

template <class L>
void Describe(const Patch& patch, float cosine, float sine, float* histogram) {
  constexpr int kSide = kPatchSide, kSamples = kSide * kSide, kPadded = kGradientFloats;
  const SiftTables& tables = Tables();
  alignas(64) float magnitude[kPadded], turns[kPadded];
  PatchGradients<L>(patch, cosine, sine, magnitude, turns);
  // Each magnitude is shared by two of the 8 directions.
  alignas(64) float first[kPadded], second[kPadded];
  alignas(64) std::int32_t bins[kPadded];
  for (int k = kSide; k < kSamples - kSide; k += L::kWidth) {
    const auto position = L::Load(turns + k) * L::Set(static_cast<float>(kOrientationBins));
    const auto bin = L::Truncate(position);
    const auto m = L::Load(magnitude + k);
    const auto upper = m * (position - L::ToFloat(bin));
    L::Store(second + k, upper);
    L::Store(first + k, m - upper);
    L::StoreI(bins + k, bin);
  }
  // Sample rows come in groups of kCellSamples that lie between the same two cell rows; one sum for each row of the
  // group, so that neighbouring additions do not wait for each other.
  alignas(64) float part[kCellSamples][kOrientationBins][8];
  for (int i = 0; i < kCells * kCells * kOrientationBins; ++i) histogram[i] = 0;
  for (int group = 0; group <= kCells; ++group) {
    std::memset(part, 0, sizeof part);
    const int begin = (1 + group * kCellSamples) * kSide;
    for (int column = 1; column < kSide - 1; ++column) {
#pragma GCC unroll 4
      for (int r = 0; r < kCellSamples; ++r) {
        const int k = begin + r * kSide + column;
        const int bin = bins[k] & (kOrientationBins - 1), next = (bin + 1) & (kOrientationBins - 1);
        L::AddScaled8(part[r][bin], tables.cell_weights[k], first[k]);
        L::AddScaled8(part[r][next], tables.cell_weights[k], second[k]);
      }
    }
    for (int half = 0; half < 2; ++half) {
      const int cell_row = group - 1 + half;
      if (cell_row < 0 || cell_row >= kCells) continue;
      for (int bin = 0; bin < kOrientationBins; ++bin) {
        for (int cell = 0; cell < kCells; ++cell) {
          float sum = 0;
          for (int r = 0; r < kCellSamples; ++r) sum += part[r][bin][half * kCells + cell];
          histogram[(cell_row * kCells + cell) * kOrientationBins + bin] += sum;
        }
      }
    }
  }
}

// ---- projections ----------------------------------------------------------------------------------------------------

/// kRows x (kVectors kWidth) values of a product.
template <class L, int kRows, int kVectors>
void MultiplyBlock(const float* a, int inner, const float* b, int columns, float* out) {
  typename L::F sum[kRows][kVectors];
  for (auto& row : sum)
    for (auto& value : row) value = L::Set(0.0F);
  for (int i = 0; i < inner; ++i, b += columns) {
    for (int r = 0; r < kRows; ++r) {
      const auto factor = L::Set(a[r * inner + i]);
      for (int v = 0; v < kVectors; ++v) sum[r][v] = sum[r][v] + factor * L::Load(b + v * L::kWidth);
    }
  }
  for (int r = 0; r < kRows; ++r)
    for (int v = 0; v < kVectors; ++v) L::Store(out + r * columns + v * L::kWidth, sum[r][v]);
}

template <class L>
void Multiply(const float* a, int rows, int inner, const float* b, int columns, float* out) {
  if (rows == 1) {
    for (int x = 0; x < columns; x += 64) MultiplyBlock<L, 1, 64 / L::kWidth>(a, inner, b + x, columns, out + x);
    return;
  }
  for (int r = 0; r < rows; r += 4)
    for (int x = 0; x < columns; x += 16)
      MultiplyBlock<L, 4, 16 / L::kWidth>(a + r * inner, inner, b + x, columns, out + r * columns + x);
}

template <class L>
constexpr SiftKernels MakeSiftKernels(std::string_view name) {
  return {name, Upsample<L>, Blur<L>, Search<L>, Orient<L>, Describe<L>, Sample<L>, PatchGradients<L>, Multiply<L>};
}

}  // namespace rilievo::features
