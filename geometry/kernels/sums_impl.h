// Sums of the least-squares refinements, written once over the lanes of a processor level (docs/decisions/0009): eight
// lanes of sums, which are then added 4 + 4, 2 + 2, 1 + 1.
#pragma once

#include "geometry/kernels/two_view_kernels.h"

namespace rilievo::kernels {

inline constexpr int kSumLanes = 8;

/// kSums sums of eight lanes each, as V vectors of a level.
template <class L, int kSums>
struct LaneSums {
  static constexpr int kVectors = kSumLanes / L::kWidth;
  typename L::D sums[kSums][kVectors];

  LaneSums() {
    for (int s = 0; s < kSums; ++s) {
      for (int v = 0; v < kVectors; ++v) sums[s][v] = L::Set(0.0);
    }
  }
  void Add(int sum, int vector, typename L::D value) { sums[sum][vector] = sums[sum][vector] + value; }
  double Total(int sum) const {
    double lanes[kSumLanes];
    for (int v = 0; v < kVectors; ++v) L::Store(lanes + v * L::kWidth, sums[sum][v]);
    for (int half = kSumLanes / 2; half > 0; half /= 2) {
      for (int i = 0; i < half; ++i) lanes[i] = lanes[i] + lanes[i + half];
    }
    return lanes[0];
  }
};

inline constexpr double kLaneIndex[kSumLanes] = {0, 1, 2, 3, 4, 5, 6, 7};

/// r = y'Mx / sqrt(D), D = v1 (c^2 + d^2) + v2 (a^2 + b^2) with (a, b) = (Mx)_12, (c, d) = (M'y)_12;
/// dr/dM = y x' / sqrt(D) - (y'Mx) / D^(3/2) (v2 (a, b, 0)' x' + v1 y (c, d, 0)).
template <class L>
void AddSampson(const double* matrix, double variance_1, double variance_2, const PairColumns& pairs, MatrixSums& out) {
  using D = typename L::D;
  D m[9];
  for (int k = 0; k < 9; ++k) m[k] = L::Set(matrix[k]);
  const D v1 = L::Set(variance_1), v2 = L::Set(variance_2), zero = L::Set(0.0), one = L::Set(1.0);
  const D end = L::Set(static_cast<double>(pairs.size));
  LaneSums<L, 55> sums;
  for (int begin = 0; begin < pairs.size; begin += kSumLanes) {
    for (int v = 0; v < LaneSums<L, 55>::kVectors; ++v) {
      const int at = begin + v * L::kWidth;
      const D x1 = L::Load(pairs.x1 + at), y1 = L::Load(pairs.y1 + at), x2 = L::Load(pairs.x2 + at),
              y2 = L::Load(pairs.y2 + at);
      const D a = m[0] * x1 + m[1] * y1 + m[2], b = m[3] * x1 + m[4] * y1 + m[5];
      const D c = m[0] * x2 + m[3] * y2 + m[6], d = m[1] * x2 + m[4] * y2 + m[7];
      const D error = x2 * a + y2 * b + (m[6] * x1 + m[7] * y1 + m[8]);
      const D divisor = v1 * (c * c + d * d) + v2 * (a * a + b * b);
      const auto counts =
          L::And(L::Less(L::Set(static_cast<double>(at)) + L::Load(kLaneIndex), end), L::Less(zero, divisor));
      const D scale = L::Select(counts, one / L::Sqrt(L::Select(counts, divisor, one)), zero);
      const D share = error * (scale * scale), r = error * scale;
      // g = scale (left x' - y back'), left = y - share v2 (a, b, 0), back = share v1 (c, d, 0)
      const D left_x = x2 - share * v2 * a, left_y = y2 - share * v2 * b;
      const D back_x = share * v1 * c, back_y = share * v1 * d;
      const D g[9] = {scale * (left_x * x1 - x2 * back_x),
                      scale * (left_x * y1 - x2 * back_y),
                      scale * left_x,
                      scale * (left_y * x1 - y2 * back_x),
                      scale * (left_y * y1 - y2 * back_y),
                      scale * left_y,
                      scale * (x1 - back_x),
                      scale * (y1 - back_y),
                      scale};
      sums.Add(0, v, r * r);
      int next = 10;
      for (int i = 0; i < 9; ++i) {
        sums.Add(1 + i, v, r * g[i]);
        for (int j = i; j < 9; ++j) sums.Add(next++, v, g[i] * g[j]);
      }
    }
  }
  out.squares = sums.Total(0);
  for (int i = 0; i < 9; ++i) out.right[i] = sums.Total(1 + i);
  for (int i = 0; i < 45; ++i) out.normal[i] = sums.Total(10 + i);
}

template <class L>
void AddTransfer(const double* matrix, const PairColumns& pairs, TransferSums& out) {
  using D = typename L::D;
  D h[9];
  for (int k = 0; k < 9; ++k) h[k] = L::Set(matrix[k]);
  const D zero = L::Set(0.0), one = L::Set(1.0), end = L::Set(static_cast<double>(pairs.size));
  LaneSums<L, 35> sums;
  for (int begin = 0; begin < pairs.size; begin += kSumLanes) {
    for (int v = 0; v < LaneSums<L, 35>::kVectors; ++v) {
      const int at = begin + v * L::kWidth;
      const D x = L::Load(pairs.x1 + at), y = L::Load(pairs.y1 + at);
      const D w = h[6] * x + h[7] * y + h[8];
      const auto exists = L::Less(L::Set(static_cast<double>(at)) + L::Load(kLaneIndex), end);
      const auto counts = L::And(exists, L::Less(zero, w));
      const D scale = L::Select(counts, one / L::Select(counts, w, one), zero);
      const D px = (h[0] * x + h[1] * y + h[2]) * scale, py = (h[3] * x + h[4] * y + h[5]) * scale;
      const D dx = L::Select(counts, px - L::Load(pairs.x2 + at), zero);
      const D dy = L::Select(counts, py - L::Load(pairs.y2 + at), zero);
      sums.Add(0, v, dx * dx + dy * dy);
      sums.Add(1, v, L::Select(exists, L::Select(counts, zero, one), zero));
      const D sx = scale * x, sy = scale * y, along = zero - (px * dx + py * dy);
      const D rays[3] = {sx, sy, scale}, errors[3] = {dx, dy, along};
      for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) sums.Add(2 + 3 * i + j, v, errors[i] * rays[j]);
      }
      const D factors[4] = {one, px, py, px * px + py * py};
      const D products[6] = {sx * sx, sx * sy, sx * scale, sy * sy, sy * scale, scale * scale};
      for (int i = 0; i < 4; ++i) {
        for (int j = 0; j < 6; ++j) sums.Add(11 + 6 * i + j, v, factors[i] * products[j]);
      }
    }
  }
  out.squares = sums.Total(0);
  out.behind = sums.Total(1);
  for (int i = 0; i < 9; ++i) out.right[i] = sums.Total(2 + i);
  for (int i = 0; i < 24; ++i) out.normal[i] = sums.Total(11 + i);
}

}  // namespace rilievo::kernels
