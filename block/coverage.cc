// The coverage grid.
#include "block/coverage.h"

#include <algorithm>

namespace rilievo {

void CoverageGrid::Add(const Eigen::Vector2d& position_px) {
  const auto cell = [](double position, int size_px) {
    return std::clamp(static_cast<int>(position * kCells / size_px), 0, kCells - 1);
  };
  cells_.set(static_cast<std::size_t>(cell(position_px.y(), height_px_) * kCells + cell(position_px.x(), width_px_)));
}

double Coverage(std::span<const Keypoint> keypoints, int width_px, int height_px) {
  CoverageGrid grid(width_px, height_px);
  for (const Keypoint& keypoint : keypoints) grid.Add(keypoint.Position());
  return grid.Share();
}

}  // namespace rilievo
