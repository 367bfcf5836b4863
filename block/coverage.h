// How evenly points cover an image: the share of the cells of a fixed grid that hold one.
#pragma once

#include <Eigen/Core>
#include <bitset>
#include <span>

#include "block/features.h"

namespace rilievo {

/// A grid of 8 x 8 cells over an image of any size.
class CoverageGrid {
 public:
  CoverageGrid(int width_px, int height_px) : width_px_(width_px), height_px_(height_px) {}
  /// A position outside the image counts for the cell at its border.
  void Add(const Eigen::Vector2d& position_px);
  /// 0..1
  double Share() const { return static_cast<double>(cells_.count()) / static_cast<double>(cells_.size()); }

 private:
  static constexpr int kCells = 8;
  int width_px_, height_px_;
  std::bitset<kCells * kCells> cells_;
};

/// The coverage of an image by its features. O(features).
double Coverage(std::span<const Keypoint> keypoints, int width_px, int height_px);

}  // namespace rilievo
