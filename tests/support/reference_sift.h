// SIFT written plainly from its paper (Lowe 2004) in double precision: what the fast one must agree with.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "block/pixels.h"

namespace rilievo::testing_support {

struct ReferencePlane {
  int width = 0, height = 0;
  std::vector<double> value;
  double At(int x, int y) const {
    const auto mirror = [](int i, int n) {
      while (i < 0 || i >= n) i = i < 0 ? -1 - i : 2 * n - 1 - i;
      return i;
    };
    return value[static_cast<std::size_t>(mirror(y, height)) * static_cast<std::size_t>(width) +
                 static_cast<std::size_t>(mirror(x, width))];
  }
  /// Bilinear; (x, y) in pixels from the corner of the plane.
  double Sample(double x, double y) const {
    const int c = static_cast<int>(std::floor(x - 0.5)), r = static_cast<int>(std::floor(y - 0.5));
    const double fx = x - 0.5 - c, fy = y - 0.5 - r;
    return (1 - fy) * ((1 - fx) * At(c, r) + fx * At(c + 1, r)) +
           fy * ((1 - fx) * At(c, r + 1) + fx * At(c + 1, r + 1));
  }
};

inline ReferencePlane Blurred(const ReferencePlane& in, double sigma) {
  const int radius = static_cast<int>(std::ceil(6 * sigma));
  std::vector<double> weights;
  double sum = 0;
  for (int i = -radius; i <= radius; ++i) sum += weights.emplace_back(std::exp(-i * i / (2 * sigma * sigma)));
  ReferencePlane across = in, out = in;
  for (int y = 0; y < in.height; ++y) {
    for (int x = 0; x < in.width; ++x) {
      double v = 0;
      for (int i = -radius; i <= radius; ++i)
        v += weights[static_cast<std::size_t>(i + radius)] / sum * in.At(x + i, y);
      across.value[static_cast<std::size_t>(y * in.width + x)] = v;
    }
  }
  for (int y = 0; y < in.height; ++y) {
    for (int x = 0; x < in.width; ++x) {
      double v = 0;
      for (int i = -radius; i <= radius; ++i)
        v += weights[static_cast<std::size_t>(i + radius)] / sum * across.At(x, y + i);
      out.value[static_cast<std::size_t>(y * in.width + x)] = v;
    }
  }
  return out;
}

inline ReferencePlane PlaneOf(const GreyImage& image) {
  ReferencePlane plane{image.width_px, image.height_px, {}};
  for (const std::uint8_t v : image.u8) plane.value.push_back(v);
  return plane;
}

/// The image at the blur `sigma_px` (in its pixels), its own blur being 0.5.
inline ReferencePlane AtScale(const GreyImage& image, double sigma_px) {
  return Blurred(PlaneOf(image), std::sqrt(sigma_px * sigma_px - 0.25));
}

/// Section 6 of the paper: gradients around (x, y) in the frame of the direction, weighted by a Gaussian of half the
/// window, shared between 4 x 4 cells of 3 sigma and 8 directions by trilinear interpolation; unit norm, cut at 0.2,
/// unit norm. `layer` is the image at the blur of the keypoint's layer. Gradients are taken on a fine grid.
inline std::array<double, 128> ReferenceDescriptor(const ReferencePlane& layer, double x, double y, double sigma_px,
                                                   double angle_rad, int samples_per_cell) {
  std::array<double, 128> histogram{};
  const double cell = 3 * sigma_px, step = cell / samples_per_cell, c = std::cos(angle_rad), s = std::sin(angle_rad);
  const auto at = [&](double u, double v) { return layer.Sample(x + c * u - s * v, y + s * u + c * v); };
  const double delta = 0.25 * cell;
  for (int i = 0; i < 5 * samples_per_cell; ++i) {
    for (int j = 0; j < 5 * samples_per_cell; ++j) {
      const double u = (j + 0.5 - 2.5 * samples_per_cell) * step, v = (i + 0.5 - 2.5 * samples_per_cell) * step;
      const double du = at(u + delta, v) - at(u - delta, v), dv = at(u, v + delta) - at(u, v - delta);
      const double weight = std::exp(-(u * u + v * v) / (2 * 4 * cell * cell)) * std::hypot(du, dv);
      double turns = std::atan2(dv, du) / (2 * std::numbers::pi);
      if (turns < 0) turns += 1;
      for (int row = 0; row < 4; ++row) {
        for (int column = 0; column < 4; ++column) {
          const double wy = 1 - std::abs(v / cell + 1.5 - row), wx = 1 - std::abs(u / cell + 1.5 - column);
          if (wx <= 0 || wy <= 0) continue;
          for (int bin = 0; bin < 8; ++bin) {
            const double wt = 1 - std::abs(std::remainder(8 * turns - bin, 8.0));
            if (wt > 0) histogram[static_cast<std::size_t>((row * 4 + column) * 8 + bin)] += weight * wx * wy * wt;
          }
        }
      }
    }
  }
  for (int pass = 0; pass < 2; ++pass) {
    double norm = 0;
    for (const double h : histogram) norm += h * h;
    for (double& h : histogram) h = h / std::sqrt(norm);
    if (pass == 0)
      for (double& h : histogram) h = std::min(h, 0.2);
  }
  return histogram;
}

}  // namespace rilievo::testing_support
