// Rays of all pixels of a camera: the inverse of the distortion on a grid, interpolated.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "block/camera.h"

namespace rilievo::simulation {

/// Ideal coordinates (X/Z, Y/Z) at any position of the image. Nodes every 16 px come from CameraModel::Normalize; cubic
/// Lagrange interpolation between them is exact to about 1e-9 for lenses with a few per cent of distortion.
class RayGrid {
 public:
  /// Throws Error(kInvalidInput) when the distortion cannot be inverted within 32 px of the image. Cost about 1 ns a
  /// pixel.
  explicit RayGrid(const Camera& camera);

  /// Ideal coordinates of the pixel frame position (x, y), inside the image.
  Eigen::Vector2d At(double x_px, double y_px) const;
  /// Ideal coordinates of (x_px + i, y_px), i = 0..count-1, where the fraction of x_px is used for all.
  void Row(double x_px, double y_px, int count, std::vector<Eigen::Vector2d>& ideal) const;

 private:
  static constexpr int kStep_px = 16;
  using Weights = std::array<double, 4>;
  static Weights Lagrange(double t);
  Eigen::Vector2d Column(int node_x, int node_y, const Weights& weights) const;

  int columns_ = 0, rows_ = 0;
  std::vector<Eigen::Vector2d> nodes_;  ///< node (0, 0) lies at (-16, -16) px
};

}  // namespace rilievo::simulation
