// Fills and reads the grid of rays.
#include "simulation/ray_grid.h"

#include <cmath>

#include "base/check.h"
#include "base/error.h"

namespace rilievo::simulation {

RayGrid::RayGrid(const Camera& camera)
    : columns_((camera.width_px + kStep_px - 1) / kStep_px + 4),
      rows_((camera.height_px + kStep_px - 1) / kStep_px + 4) {
  nodes_.reserve(static_cast<std::size_t>(columns_) * rows_);
  for (int r = 0; r < rows_; ++r)
    for (int c = 0; c < columns_; ++c) {
      const auto ideal = camera.model.Normalize({kStep_px * (c - 1.0), kStep_px * (r - 1.0)});
      if (!ideal)
        throw Error(ErrorCode::kInvalidInput, "", "the lens distortion cannot be inverted near the image border",
                    "use weaker distortion or a longer focal length");
      nodes_.push_back(*ideal);
    }
}

RayGrid::Weights RayGrid::Lagrange(double t) {
  const double a = t + 1, b = t - 1, c = t - 2;
  return {-t * b * c / 6, a * b * c / 2, -a * t * c / 2, a * t * b / 6};
}

Eigen::Vector2d RayGrid::Column(int node_x, int node_y, const Weights& weights) const {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (int k = 0; k < 4; ++k) sum += weights[k] * nodes_[static_cast<std::size_t>(node_y + k) * columns_ + node_x];
  return sum;
}

Eigen::Vector2d RayGrid::At(double x_px, double y_px) const {
  const int cx = static_cast<int>(std::floor(x_px / kStep_px)), cy = static_cast<int>(std::floor(y_px / kStep_px));
  RILIEVO_CHECK(cx >= 0 && cy >= 0 && cx + 3 < columns_ && cy + 3 < rows_);
  const Weights wx = Lagrange(x_px / kStep_px - cx), wy = Lagrange(y_px / kStep_px - cy);
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (int k = 0; k < 4; ++k) sum += wx[k] * Column(cx + k, cy, wy);
  return sum;
}

void RayGrid::Row(double x_px, double y_px, int count, std::vector<Eigen::Vector2d>& ideal) const {
  const int first = static_cast<int>(std::floor(x_px)), cy = static_cast<int>(std::floor(y_px / kStep_px));
  const double fraction = x_px - first;
  RILIEVO_CHECK(first >= 0 && cy >= 0 && (first + count - 1) / kStep_px + 3 < columns_ && cy + 3 < rows_);
  const Weights wy = Lagrange(y_px / kStep_px - cy);
  std::array<Weights, kStep_px> wx;
  for (int i = 0; i < kStep_px; ++i) wx[i] = Lagrange((i + fraction) / kStep_px);
  ideal.resize(count);
  std::array<Eigen::Vector2d, 4> node;
  int cell = -1;
  for (int i = 0; i < count; ++i) {
    const int x = first + i;
    if (x / kStep_px != cell) {
      cell = x / kStep_px;
      for (int k = 0; k < 4; ++k) node[k] = Column(cell + k, cy, wy);
    }
    const Weights& w = wx[x % kStep_px];
    ideal[i] = (w[0] * node[0] + w[1] * node[1]) + (w[2] * node[2] + w[3] * node[3]);
  }
}

}  // namespace rilievo::simulation
