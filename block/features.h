// Keypoints and descriptors of an image.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace rilievo {

/// Position in the pixel frame (first pixel's centre (0.5, 0.5)), scale = sigma of detection in px, angle in rad
/// (0 = +x, towards +y), response = |DoG| contrast.
struct Keypoint {
  float x_px = 0, y_px = 0, scale_px = 0, angle_rad = 0, response = 0;
  Eigen::Vector2d Position() const { return {x_px, y_px}; }
};

using Rgb = std::array<std::uint8_t, 3>;

/// SIFT descriptor as 128 unsigned bytes, norm about 512 (components min(255, round(512 x))).
using SiftDescriptor = std::array<std::uint8_t, 128>;

/// Parallel arrays, one entry a feature.
struct ImageFeatures {
  std::vector<Keypoint> keypoints;
  std::vector<SiftDescriptor> descriptors;
  std::vector<Rgb> colors;  ///< pixel under the keypoint, for coloured points
};

}  // namespace rilievo
