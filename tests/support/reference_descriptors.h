// GLOH and PCA-SIFT written plainly from their papers in double precision: what the fast ones must agree with.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "stages/features/projection.h"
#include "tests/support/reference_sift.h"

namespace rilievo::testing_support {

/// Rows as the matrix that they stand for.
inline Eigen::MatrixXd ProjectionRows(const features::StoredProjection& stored) {
  Eigen::MatrixXd rows(stored.outputs, stored.inputs);
  for (int o = 0; o < stored.outputs; ++o)
    for (int i = 0; i < stored.inputs; ++i)
      rows(o, i) = static_cast<double>(stored.scales[o]) * stored.weights[o * stored.inputs + i];
  return rows;
}

inline Eigen::VectorXd ProjectionOffsets(const features::StoredProjection& stored) {
  return Eigen::Map<const Eigen::VectorXf>(stored.offsets, stored.outputs).cast<double>();
}

/// The layer around a feature in the frame of its direction, offsets in sigma.
struct ReferenceFrame {
  const ReferencePlane& layer;
  double x, y, sigma_px, angle_rad;
  double At(double u, double v) const {
    const double c = sigma_px * std::cos(angle_rad), s = sigma_px * std::sin(angle_rad);
    return layer.Sample(x + c * u - s * v, y + s * u + c * v);
  }
};

/// Mikolajczyk & Schmid 2005, section 3.2: SIFT's histogram (differences over 0.75 sigma to either side, Gaussian of 6
/// sigma, linear shares) in 17 cells of radii 6, 11, 15 (half a sigma each) and 8 sectors, 16 directions; on a grid of
/// that step in these units.
inline Eigen::VectorXd ReferenceGloh(const ReferenceFrame& frame, double step) {
  Eigen::VectorXd histogram = Eigen::VectorXd::Zero(272);
  const double middle[3] = {3, 8.5, 13}, delta = 0.75, turn = 2 * std::numbers::pi;
  const auto hat = [](double distance) { return std::max(0.0, 1 - std::abs(distance)); };
  for (double v = -15 + step / 2; v < 15; v += step) {
    for (double u = -15 + step / 2; u < 15; u += step) {
      const double radius = std::hypot(u, v);
      if (radius > 15) continue;
      const double p = 0.5 * u, q = 0.5 * v;
      const double du = frame.At(p + delta, q) - frame.At(p - delta, q);
      const double dv = frame.At(p, q + delta) - frame.At(p, q - delta);
      const double amount = std::hypot(du, dv) * std::exp(-(p * p + q * q) / (2 * 36));
      const double place = 8 * std::atan2(v, u) / turn, direction = 16 * std::atan2(dv, du) / turn;
      for (int ring = 0; ring < 3; ++ring) {
        double share = radius < middle[0] ? (ring == 0 ? 1 : 0) : radius > middle[2] ? (ring == 2 ? 1 : 0) : 0;
        if (radius >= middle[0] && radius <= middle[2])
          share = hat((radius - middle[ring]) / (ring == 0 || (ring == 1 && radius < 8.5) ? 5.5 : 4.5));
        for (int sector = 0; sector < 8; ++sector) {
          const double angular = ring == 0 ? (sector == 0 ? 1 : 0) : hat(std::remainder(place - sector, 8.0));
          const int cell = ring == 0 ? 0 : 1 + 8 * (ring - 1) + sector;
          for (int bin = 0; bin < 16; ++bin)
            histogram(16 * cell + bin) += amount * share * angular * hat(std::remainder(direction - bin, 16.0));
        }
      }
    }
  }
  histogram = histogram.normalized().cwiseMin(0.2);
  return histogram.normalized();
}

/// Ke & Sukthankar 2004, section 3: horizontal, then vertical gradients of a 41 x 41 patch (3/8 sigma a sample), 3042
/// numbers of unit norm.
inline Eigen::VectorXd ReferenceGradients(const ReferenceFrame& frame) {
  Eigen::VectorXd gradients(3042);
  const double step = 0.375;
  for (int row = 0; row < 39; ++row) {
    for (int column = 0; column < 39; ++column) {
      const double u = step * (column - 19), v = step * (row - 19);
      gradients(39 * row + column) = frame.At(u + step, v) - frame.At(u - step, v);
      gradients(1521 + 39 * row + column) = frame.At(u, v + step) - frame.At(u, v - step);
    }
  }
  return gradients.normalized();
}

/// The rows that project those 3042 numbers, out of rows in cosines: weight [axis][k][l] of frequency k down, l across.
inline Eigen::MatrixXd GradientRows(const Eigen::MatrixXd& cosine_rows) {
  Eigen::MatrixXd basis(39, 16);
  for (int i = 0; i < 39; ++i)
    for (int k = 0; k < 16; ++k)
      basis(i, k) = std::sqrt((k == 0 ? 1.0 : 2.0) / 39) * std::cos(std::numbers::pi * (i + 0.5) * k / 39);
  Eigen::MatrixXd rows(cosine_rows.rows(), 3042);
  for (Eigen::Index o = 0; o < rows.rows(); ++o) {
    for (int axis = 0; axis < 2; ++axis) {
      Eigen::MatrixXd weights(16, 16);
      for (int k = 0; k < 256; ++k) weights(k / 16, k % 16) = cosine_rows(o, 256 * axis + k);
      const Eigen::MatrixXd map = basis * weights * basis.transpose();
      for (int i = 0; i < 1521; ++i) rows(o, 1521 * axis + i) = map(i / 39, i % 39);
    }
  }
  return rows;
}

}  // namespace rilievo::testing_support
