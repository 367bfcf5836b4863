// SURF written plainly from the paper (Bay et al. 2008), in double precision and without an integral image: the oracle
// of its tests.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "block/features.h"
#include "block/pixels.h"

namespace rilievo::testing_support {

class SurfReference {
 public:
  explicit SurfReference(const GreyImage& image, double grey_unit = 1) : image_(image), unit_(grey_unit) {}

  /// Mean over nothing: the plain sum of pixels [x0, x1) x [y0, y1), half-sample reflection outside.
  double Box(int x0, int y0, int x1, int y1) const {
    double sum = 0;
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) sum += At(x, y);
    }
    return sum;
  }

  struct Hessian {
    double det = 0, trace = 0;
  };
  /// Filters of figure 2 of the paper centred on pixel (x, y): lobes of size/3.
  Hessian HessianAt(int x, int y, int size) const {
    const int l = size / 3, far = size / 2, half = l / 2;
    const auto box = [&](int left, int top, int right, int bottom) {  // inclusive, relative to the centre
      return Box(x + left, y + top, x + right + 1, y + bottom + 1);
    };
    const double area = size * size / unit_;
    const double xx = (box(-far, -(l - 1), far, l - 1) - 3 * box(-half, -(l - 1), half, l - 1)) / area;
    const double yy = (box(-(l - 1), -far, l - 1, far) - 3 * box(-(l - 1), -half, l - 1, half)) / area;
    const double xy = (box(1, 1, l, l) + box(-l, -l, -1, -1) - box(1, -l, l, -1) - box(-l, 1, -1, l)) / area;
    return {xx * yy - 0.81 * xy * xy, xx + yy};
  }

  /// Keypoints without orientation, by exhaustive comparison of all samples.
  std::vector<Keypoint> Detect(double threshold) const {
    const int sizes[4][4] = {{9, 15, 21, 27}, {15, 27, 39, 51}, {27, 51, 75, 99}, {51, 99, 147, 195}};
    std::vector<Keypoint> found;
    for (int octave = 0; octave < 4; ++octave) {
      const int step = 1 << octave, columns = (image_.width_px + step - 1) / step,
                rows = (image_.height_px + step - 1) / step;
      std::vector<Hessian> h[4];
      for (int layer = 0; layer < 4; ++layer) {
        for (int i = 0; i < columns * rows; ++i) {
          const int x = i % columns * step, y = i / columns * step, reach = sizes[octave][layer] / 2;
          const bool is_covered =
              x >= reach && y >= reach && x + reach < image_.width_px && y + reach < image_.height_px;
          h[layer].push_back(is_covered ? HessianAt(x, y, sizes[octave][layer]) : Hessian{NAN, NAN});
        }
      }
      for (int layer = 1; layer <= 2; ++layer) {
        for (int i = 0; i < columns * rows; ++i) {
          const auto at = [&](int s, int r, int c) {
            const int column = i % columns + c, row = i / columns + r;
            if (column < 0 || row < 0 || column >= columns || row >= rows) return static_cast<double>(NAN);
            return h[layer + s][static_cast<std::size_t>(row * columns + column)].det;
          };
          const double value = at(0, 0, 0);
          bool is_largest = value > threshold;
          for (int k = 0; k < 27 && is_largest; ++k)
            is_largest = k == 13 || value > at(k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1);
          if (!is_largest) continue;
          Eigen::Matrix3d second;
          const Eigen::Vector3d first((at(0, 0, 1) - at(0, 0, -1)) / 2, (at(0, 1, 0) - at(0, -1, 0)) / 2,
                                      (at(1, 0, 0) - at(-1, 0, 0)) / 2);
          const auto along = [&](int a, int d) { return at(a == 2 ? d : 0, a == 1 ? d : 0, a == 0 ? d : 0); };
          const auto across = [&](int a, int b, int d, int e) {
            const auto p = [&](int axis) { return (axis == a ? d : 0) + (axis == b ? e : 0); };
            return at(p(2), p(1), p(0));
          };
          for (int a = 0; a < 3; ++a) {
            for (int b = 0; b < 3; ++b) {
              second(a, b) =
                  a == b ? along(a, 1) + along(a, -1) - 2 * value
                         : (across(a, b, 1, 1) + across(a, b, -1, -1) - across(a, b, 1, -1) - across(a, b, -1, 1)) / 4;
            }
          }
          const Eigen::Vector3d offset = -second.inverse() * first;
          if (offset.cwiseAbs().maxCoeff() > 1) continue;
          Keypoint k;
          k.x_px = static_cast<float>((i % columns + offset[0]) * step + 0.5);
          k.y_px = static_cast<float>((i / columns + offset[1]) * step + 0.5);
          const int* size = sizes[octave];
          k.scale_px = static_cast<float>(1.2 / 9 * (size[layer] + offset[2] * (size[layer + 1] - size[layer])));
          k.response = static_cast<float>(value);
          k.sign = h[layer][static_cast<std::size_t>(i)].trace < 0 ? 1 : -1;
          found.push_back(k);
        }
      }
    }
    return found;
  }

  /// Section 4.1, the sector at 72 positions.
  double Orientation(const Keypoint& k) const {
    std::array<Eigen::Vector2d, 72> bins;
    bins.fill(Eigen::Vector2d::Zero());
    const double s = k.scale_px;
    for (int v = -6; v <= 6; ++v) {
      for (int u = -6; u <= 6; ++u) {
        if (u * u + v * v > 36) continue;
        const Eigen::Vector2d d = Haar(k.x_px + u * s, k.y_px + v * s, 2 * s);
        if (d.isZero()) continue;
        const double turn = std::atan2(d.y(), d.x()) / (2 * std::numbers::pi);
        const int bin = std::min(71, static_cast<int>(72 * (turn < 0 ? turn + 1 : turn)));
        bins[static_cast<std::size_t>(bin)] += std::exp(-(u * u + v * v) / 8.0) * d;
      }
    }
    Eigen::Vector2d longest(0, 0);
    for (std::size_t k0 = 0; k0 < 72; ++k0) {
      Eigen::Vector2d sum(0, 0);
      for (std::size_t j = 0; j < 12; ++j) sum += bins[(k0 + j) % 72];
      if (sum.norm() > longest.norm()) longest = sum;
    }
    const double angle = std::atan2(longest.y(), longest.x());
    return angle < 0 ? angle + 2 * std::numbers::pi : angle;
  }

  /// Section 4.2: unit vector of 64 or 128 elements.
  std::vector<double> Describe(const Keypoint& k, int elements) const {
    const double s = k.scale_px, c = std::cos(k.angle_rad), n = std::sin(k.angle_rad);
    std::vector<double> result;
    for (int cell = 0; cell < 16; ++cell) {
      double sums[4] = {}, split[8] = {};
      for (int i = 0; i < 25; ++i) {
        const double u = 5 * (cell % 4) + i % 5 - 9.5, v = 5 * (cell / 4) + i / 5 - 9.5;
        const Eigen::Vector2d d = std::exp(-(u * u + v * v) / (2 * 3.3 * 3.3)) *
                                  Haar(k.x_px + s * (u * c - v * n), k.y_px + s * (u * n + v * c), s);
        const double dx = c * d.x() + n * d.y(), dy = -n * d.x() + c * d.y();
        sums[0] += dx, sums[1] += dy, sums[2] += std::abs(dx), sums[3] += std::abs(dy);
        double* of_x = split + (dy < 0 ? 0 : 2);
        of_x[0] += dx, of_x[1] += std::abs(dx);
        double* of_y = split + (dx < 0 ? 4 : 6);
        of_y[0] += dy, of_y[1] += std::abs(dy);
      }
      if (elements == 64) result.insert(result.end(), sums, sums + 4);
      if (elements == 128) result.insert(result.end(), split, split + 8);
    }
    double norm_sq = 0;
    for (const double v : result) norm_sq += v * v;
    for (double& v : result) v /= std::sqrt(norm_sq);
    return result;
  }

 private:
  double At(int x, int y) const {
    while (x < 0 || x >= image_.width_px) x = x < 0 ? -1 - x : 2 * image_.width_px - 1 - x;
    while (y < 0 || y >= image_.height_px) y = y < 0 ? -1 - y : 2 * image_.height_px - 1 - y;
    const auto i = static_cast<std::size_t>(y * image_.width_px + x);
    return image_.Is16Bit() ? image_.u16[i] : image_.u8[i];
  }
  /// Wavelets of side 2 half around the pixel corner nearest to (x, y).
  Eigen::Vector2d Haar(double x, double y, double half) const {
    const int cx = static_cast<int>(std::nearbyint(x)), cy = static_cast<int>(std::nearbyint(y)),
              h = static_cast<int>(std::nearbyint(half));
    return {Box(cx, cy - h, cx + h, cy + h) - Box(cx - h, cy - h, cx, cy + h),
            Box(cx - h, cy, cx + h, cy + h) - Box(cx - h, cy - h, cx + h, cy)};
  }

  const GreyImage& image_;
  double unit_;
};

}  // namespace rilievo::testing_support
