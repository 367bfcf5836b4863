// Residuals and scores of blocks of pairs, written once over the lanes of a processor level (docs/decisions/0009).
// Products and sums are rounded one by one: on a processor without FMA the scalar kernel stays fast.
#pragma once

#include "geometry/kernels/two_view_kernels.h"

namespace rilievo::kernels {

/// Sampson's squared distance, or the sum of both squared distances to the epipolar lines.
template <class L, bool kBoth>
void Epipolar(const float* m, float variance_1, float variance_2, const PairBlock& b, float* squared) {
  using F = typename L::F;
  const F m0 = L::Set(m[0]), m1 = L::Set(m[1]), m2 = L::Set(m[2]), m3 = L::Set(m[3]), m4 = L::Set(m[4]),
          m5 = L::Set(m[5]), m6 = L::Set(m[6]), m7 = L::Set(m[7]), m8 = L::Set(m[8]);
  const F v1 = L::Set(variance_1), v2 = L::Set(variance_2);
  for (int i = 0; i < kPairBlock; i += L::kWidth) {
    const F x1 = L::Load(b.x1 + i), y1 = L::Load(b.y1 + i), x2 = L::Load(b.x2 + i), y2 = L::Load(b.y2 + i);
    const F line_x = m0 * x1 + m1 * y1 + m2;
    const F line_y = m3 * x1 + m4 * y1 + m5;
    const F line_1 = m6 * x1 + m7 * y1 + m8;
    const F back_x = m0 * x2 + m3 * y2 + m6;
    const F back_y = m1 * x2 + m4 * y2 + m7;
    const F error = x2 * line_x + y2 * line_y + line_1;
    const F first = v1 * (back_x * back_x + back_y * back_y);
    const F second = v2 * (line_x * line_x + line_y * line_y);
    if constexpr (kBoth) {
      L::Store(squared + i, error * error * (first + second) / (first * second));
    } else {
      L::Store(squared + i, error * error / (first + second));
    }
  }
}

template <class L>
void Transfer(const float* m, const float* n, float variance_1, float variance_2, const PairBlock& b, float* squared) {
  using F = typename L::F;
  F h[9], g[9];
  for (int k = 0; k < 9; ++k) {
    h[k] = L::Set(m[k]);
    g[k] = L::Set(n[k]);
  }
  const F w1 = L::Set(0.5F / variance_1), w2 = L::Set(0.5F / variance_2), zero = L::Set(0.0F), far = L::Set(1e30F);
  for (int i = 0; i < kPairBlock; i += L::kWidth) {
    const F x1 = L::Load(b.x1 + i), y1 = L::Load(b.y1 + i), x2 = L::Load(b.x2 + i), y2 = L::Load(b.y2 + i);
    const F there_1 = h[6] * x1 + h[7] * y1 + h[8], back_1 = g[6] * x2 + g[7] * y2 + g[8];
    const F there_x = (h[0] * x1 + h[1] * y1 + h[2]) / there_1 - x2;
    const F there_y = (h[3] * x1 + h[4] * y1 + h[5]) / there_1 - y2;
    const F back_x = (g[0] * x2 + g[1] * y2 + g[2]) / back_1 - x1;
    const F back_y = (g[3] * x2 + g[4] * y2 + g[5]) / back_1 - y1;
    const F mean = w2 * (there_x * there_x + there_y * there_y) + w1 * (back_x * back_x + back_y * back_y);
    L::Store(squared + i, L::Select(L::Less(zero, there_1 * back_1), mean, far));
  }
}

/// Sums in sixteen lanes, which are then added pairwise, 8 + 8, 4 + 4, 2 + 2, 1 + 1.
template <class L>
BlockScore Truncate(const float* squared, int count, float limit) {
  constexpr int kLanes = 16, kVectors = kLanes / L::kWidth;
  using F = typename L::F;
  static constexpr float kIndex[kPairBlock] = {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11, 12, 13, 14, 15,
                                               16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31,
                                               32, 33, 34, 35, 36, 37, 38, 39, 40, 41, 42, 43, 44, 45, 46, 47,
                                               48, 49, 50, 51, 52, 53, 54, 55, 56, 57, 58, 59, 60, 61, 62, 63};
  const F scale = L::Set(1 / limit), one = L::Set(1.0F), zero = L::Set(0.0F), end = L::Set(static_cast<float>(count));
  F cost[kVectors], inliers[kVectors];
  for (int v = 0; v < kVectors; ++v) cost[v] = inliers[v] = zero;
  for (int i = 0; i < kPairBlock; i += kLanes) {
    for (int v = 0; v < kVectors; ++v) {
      const int at = i + v * L::kWidth;
      const F share = L::Load(squared + at) * scale;
      const auto is_inlier = L::Less(share, one);  // NaN is none
      const auto counts = L::Less(L::Load(kIndex + at), end);
      cost[v] = cost[v] + L::Select(counts, L::Select(is_inlier, share, one), zero);
      inliers[v] = inliers[v] + L::Select(counts, L::Select(is_inlier, one, zero), zero);
    }
  }
  float costs[kLanes], counts[kLanes];
  for (int v = 0; v < kVectors; ++v) {
    L::Store(costs + v * L::kWidth, cost[v]);
    L::Store(counts + v * L::kWidth, inliers[v]);
  }
  for (int half = kLanes / 2; half > 0; half /= 2) {
    for (int i = 0; i < half; ++i) {
      costs[i] = costs[i] + costs[i + half];
      counts[i] = counts[i] + counts[i + half];
    }
  }
  return {costs[0], static_cast<int>(counts[0])};
}

}  // namespace rilievo::kernels
