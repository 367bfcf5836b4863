// Interpolation, orientation and descriptor of one feature, from what the kernels deliver; doubles, no library
// functions.
#include "stages/features/surf_feature.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "stages/features/surf_geometry.h"

namespace rilievo::features::surf {
namespace {

/// |t| <= 1: halved once by atan(t) = pi/4 + atan((t - 1) / (t + 1)), then Taylor to the 33rd power.
double Arctangent(double t) {
  const double size = std::abs(t), tan_eighth = std::numbers::sqrt2 - 1;
  const double r = size > tan_eighth ? (size - 1) / (size + 1) : size, r_sq = r * r;
  double sum = 0;
  for (int k = 33; k >= 1; k -= 2) sum = 1.0 / k - r_sq * sum;
  const double angle = (size > tan_eighth ? std::numbers::pi / 4 : 0.0) + r * sum;
  return t < 0 ? -angle : angle;
}

}  // namespace

Offset Interpolate(const Neighborhood& around) {
  const auto& v = around.value;
  const auto at = [&](int layer, int y, int x) { return static_cast<double>(v[1 + layer][1 + y][1 + x]); };
  const double twice = 2 * at(0, 0, 0);
  const double gx = (at(0, 0, 1) - at(0, 0, -1)) / 2, gy = (at(0, 1, 0) - at(0, -1, 0)) / 2,
               gs = (at(1, 0, 0) - at(-1, 0, 0)) / 2;
  const double xx = at(0, 0, 1) + at(0, 0, -1) - twice, yy = at(0, 1, 0) + at(0, -1, 0) - twice,
               ss = at(1, 0, 0) + at(-1, 0, 0) - twice;
  const double xy = (at(0, 1, 1) - at(0, 1, -1) - at(0, -1, 1) + at(0, -1, -1)) / 4;
  const double xs = (at(1, 0, 1) - at(1, 0, -1) - at(-1, 0, 1) + at(-1, 0, -1)) / 4;
  const double ys = (at(1, 1, 0) - at(1, -1, 0) - at(-1, 1, 0) + at(-1, -1, 0)) / 4;
  // H offset = -g by cofactors of the symmetric H.
  const double c_xx = yy * ss - ys * ys, c_xy = xs * ys - xy * ss, c_xs = xy * ys - yy * xs;
  const double c_yy = xx * ss - xs * xs, c_ys = xy * xs - xx * ys, c_ss = xx * yy - xy * xy;
  const double det = xx * c_xx + xy * c_xy + xs * c_xs;
  if (det == 0) return {};
  Offset offset{.x = -(c_xx * gx + c_xy * gy + c_xs * gs) / det,
                .y = -(c_xy * gx + c_yy * gy + c_ys * gs) / det,
                .layer = -(c_xs * gx + c_ys * gy + c_ss * gs) / det};
  offset.is_inside = std::abs(offset.x) <= kLargestOffset && std::abs(offset.y) <= kLargestOffset &&
                     std::abs(offset.layer) <= kLargestOffset;
  return offset;
}

Direction DirectionOf(const CircleResponses& responses) {
  constexpr int kSector = kBins / 6;
  static_assert(kSector == 12);
  constexpr std::size_t kEnd = kBins + kSector;
  double ring[kEnd][2] = {};  // sums of x and y, then of sectors that begin at a bin
  for (int i = 0; i < kCircleSamples; ++i) {
    double* sum = ring[responses.bin[i]];
    sum[0] += static_cast<double>(responses.x[i]);
    sum[1] += static_cast<double>(responses.y[i]);
  }
  std::copy(&ring[0][0], &ring[kSector][0], &ring[kBins][0]);
  const auto widen = [&ring](std::size_t begin_of_last, std::size_t by) {
    for (std::size_t k = 0; k < begin_of_last; ++k) {
      for (std::size_t axis = 0; axis < 2; ++axis) ring[k][axis] += ring[k + by][axis];
    }
  };
  for (std::size_t k = 0; k < kEnd - 2; ++k) {
    for (std::size_t axis = 0; axis < 2; ++axis) ring[k][axis] += ring[k + 1][axis] + ring[k + 2][axis];
  }
  widen(kEnd - 5, 3);
  widen(kBins, 6);
  double longest_sq = 0;
  Direction best;
  for (std::size_t k = 0; k < kBins; ++k) {
    const double length_sq = ring[k][0] * ring[k][0] + ring[k][1] * ring[k][1];
    if (length_sq <= longest_sq) continue;
    longest_sq = length_sq;
    best = {ring[k][0], ring[k][1]};
  }
  if (longest_sq == 0) return {};
  const double length = std::sqrt(longest_sq);
  return {best.cosine / length, best.sine / length};
}

double AngleOf(const Direction& direction) {
  const double ax = std::abs(direction.cosine), ay = std::abs(direction.sine);
  if (ax + ay == 0) return 0;
  double angle = std::numbers::pi / 4 + Arctangent((ay - ax) / (ay + ax));
  if (direction.cosine < 0) angle = std::numbers::pi - angle;
  if (direction.sine < 0) angle = 2 * std::numbers::pi - angle;
  return std::clamp(angle, 0.0, 2 * std::numbers::pi);
}

Descriptor ToBytes(const float (*sums)[kCells], int elements) {
  std::array<double, 128> values{};
  const auto count = static_cast<std::size_t>(elements);
  for (std::size_t cell = 0; cell < kCells; ++cell) {
    double v[kComponents];
    for (std::size_t k = 0; k < kComponents; ++k) v[k] = static_cast<double>(sums[k][cell]);
    if (elements == 128) {
      std::copy(v, v + 8, values.begin() + static_cast<std::ptrdiff_t>(8 * cell));
    } else {
      const std::array<double, 4> both = {v[0] + v[2], v[4] + v[6], v[1] + v[3], v[5] + v[7]};
      std::copy(both.begin(), both.end(), values.begin() + static_cast<std::ptrdiff_t>(4 * cell));
    }
  }
  double norm_sq = 0;
  for (std::size_t i = 0; i < count; ++i) norm_sq += values[i] * values[i];
  Descriptor bytes;
  bytes.fill(128);
  if (norm_sq == 0) return bytes;
  const double scale = 256 / std::sqrt(norm_sq);
  for (std::size_t i = 0; i < count; ++i) {
    bytes[i] = static_cast<std::uint8_t>(std::clamp(128.5 + scale * values[i], 0.0, 255.0));
  }
  return bytes;
}

}  // namespace rilievo::features::surf
