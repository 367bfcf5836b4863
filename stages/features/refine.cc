// Locates an extremum of the differences of Gaussians to a fraction of a sample (Brown & Lowe 2002).
#include "stages/features/refine.h"

#include <cmath>
#include <cstdlib>
#include <numbers>

namespace rilievo::features {
namespace {

constexpr int kSteps = 5;
/// An extremum this near to the sample, in samples, is located; a little more than half, so that none in the middle
/// between two samples goes to and fro.
constexpr double kReached = 0.6;
/// Grey range in layer units: contrasts are shares of it.
constexpr double kRange = 255.0 * kUnitsPerLevel;

/// Samples that are extrema together with an equal neighbour are taken once, at the first of them.
bool HasEqualPredecessor(const LayerViews& views, int scale, int row, int column) {
  const int value = views.Difference(scale, row, column);
  for (int k = 0; k < 13; ++k) {  // the 13 neighbours before (0, 0, 0) in the order scale, row, column
    const int ds = k / 9 - 1, dr = k / 3 % 3 - 1, dc = k % 3 - 1;
    if (views.Difference(scale + ds, row + dr, column + dc) == value) return true;
  }
  return false;
}

/// Value, gradient and Hessian by central differences, in the order column, row, scale.
struct Quadratic {
  double value, g[3], h[3][3];
};

Quadratic Differentiate(const LayerViews& views, int s, int r, int c) {
  const auto d = [&](int ds, int dr, int dc) { return static_cast<double>(views.Difference(s + ds, r + dr, c + dc)); };
  Quadratic q;
  q.value = d(0, 0, 0);
  q.g[0] = 0.5 * (d(0, 0, 1) - d(0, 0, -1));
  q.g[1] = 0.5 * (d(0, 1, 0) - d(0, -1, 0));
  q.g[2] = 0.5 * (d(1, 0, 0) - d(-1, 0, 0));
  q.h[0][0] = d(0, 0, 1) + d(0, 0, -1) - 2 * q.value;
  q.h[1][1] = d(0, 1, 0) + d(0, -1, 0) - 2 * q.value;
  q.h[2][2] = d(1, 0, 0) + d(-1, 0, 0) - 2 * q.value;
  q.h[0][1] = q.h[1][0] = 0.25 * (d(0, 1, 1) - d(0, 1, -1) - d(0, -1, 1) + d(0, -1, -1));
  q.h[0][2] = q.h[2][0] = 0.25 * (d(1, 0, 1) - d(1, 0, -1) - d(-1, 0, 1) + d(-1, 0, -1));
  q.h[1][2] = q.h[2][1] = 0.25 * (d(1, 1, 0) - d(1, -1, 0) - d(-1, 1, 0) + d(-1, -1, 0));
  return q;
}

/// x = -h^-1 g by cofactors; false for a singular matrix.
bool Solve(const Quadratic& q, double* x) {
  const auto& h = q.h;
  const double c00 = h[1][1] * h[2][2] - h[1][2] * h[2][1], c01 = h[1][2] * h[2][0] - h[1][0] * h[2][2],
               c02 = h[1][0] * h[2][1] - h[1][1] * h[2][0];
  const double det = h[0][0] * c00 + h[0][1] * c01 + h[0][2] * c02;
  if (det == 0) return false;
  const double c11 = h[0][0] * h[2][2] - h[0][2] * h[2][0], c12 = h[0][1] * h[2][0] - h[0][0] * h[2][1],
               c22 = h[0][0] * h[1][1] - h[0][1] * h[1][0];
  x[0] = -(c00 * q.g[0] + c01 * q.g[1] + c02 * q.g[2]) / det;
  x[1] = -(c01 * q.g[0] + c11 * q.g[1] + c12 * q.g[2]) / det;
  x[2] = -(c02 * q.g[0] + c12 * q.g[1] + c22 * q.g[2]) / det;
  return true;
}

}  // namespace

std::optional<Extremum> Refine(const LayerViews& views, int scale, int row, int column,
                               const SiftThresholds& thresholds) {
  if (HasEqualPredecessor(views, scale, row, column)) return std::nullopt;
  const int first_row = row, first_column = column;
  for (int step = 0; step < kSteps; ++step) {
    const Quadratic q = Differentiate(views, scale, row, column);
    double x[3];
    if (!Solve(q, x)) return std::nullopt;
    // Between the last scale of one octave and the first of the next, neither may find the extremum within half a step
    // (the response is not symmetric in scale): there a step is enough.
    const bool leaves_octave = (scale == 1 && x[2] < 0) || (scale == kScales && x[2] > 0);
    if (std::fabs(x[0]) < kReached && std::fabs(x[1]) < kReached &&
        std::fabs(x[2]) < (leaves_octave ? 0.8 : kReached)) {
      const double value = q.value + 0.5 * (q.g[0] * x[0] + q.g[1] * x[1] + q.g[2] * x[2]);
      if (std::fabs(value) * kScales < thresholds.contrast * kRange) return std::nullopt;
      const double trace = q.h[0][0] + q.h[1][1], det = q.h[0][0] * q.h[1][1] - q.h[0][1] * q.h[0][1];
      const double ratio = thresholds.edge_ratio;
      if (det <= 0 || trace * trace * ratio >= (ratio + 1) * (ratio + 1) * det) return std::nullopt;
      return Extremum{scale, row, column, x[2], x[1], x[0], value, q.h[0][0], q.h[0][1], q.h[1][1]};
    }
    for (const double v : x) {
      if (!(std::fabs(v) < 4)) return std::nullopt;
    }
    column += static_cast<int>(std::nearbyint(x[0]));
    row += static_cast<int>(std::nearbyint(x[1]));
    scale += static_cast<int>(std::nearbyint(x[2]));
    if (scale < 1 || scale > kScales || std::abs(row - first_row) > kMaxMove_px ||
        std::abs(column - first_column) > kMaxMove_px)
      return std::nullopt;
  }
  return std::nullopt;
}

PositionCovariance CovarianceOf(const Extremum& e, double step_px, double surplus_px2) {
  // White noise of variance 1 through the derivative of g_b - g_a: the integral of its square is
  // (1/a^4 + 1/b^4) / (8 pi) - 1 / (pi (a^2 + b^2)^2), where a^2, b^2 are the filters' variances in image pixels.
  const auto variance_px2 = [&](double layer) {
    const double sigma_px = LayerSigma(layer, surplus_px2) * step_px;
    return sigma_px * sigma_px - kCameraSigma * kCameraSigma;
  };
  const double a2 = variance_px2(e.scale), b2 = variance_px2(e.scale + 1), sum = a2 + b2;
  const double noise = (1 / (a2 * a2) + 1 / (b2 * b2)) / (8 * std::numbers::pi) - 1 / (std::numbers::pi * sum * sum);
  // Hessian in grey levels a pixel squared of the image.
  const double unit = 1 / (static_cast<double>(kUnitsPerLevel) * step_px * step_px);
  const double xx = e.xx * unit, xy = e.xy * unit, yy = e.yy * unit, det = xx * yy - xy * xy;
  const double ixx = yy / det, ixy = -xy / det, iyy = xx / det;
  return {noise * (ixx * ixx + ixy * ixy), noise * ixy * (ixx + iyy), noise * (ixy * ixy + iyy * iyy)};
}

}  // namespace rilievo::features
