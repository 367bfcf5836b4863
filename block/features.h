// Keypoints and descriptors of an image.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace rilievo {

/// Position in the pixel frame (first pixel's centre (0.5, 0.5)), scale = sigma of detection in px, angle in rad
/// (0 = +x, towards +y), response = strength, by which features are chosen (SIFT: |DoG| contrast;
/// SURF: det H), sign = +1 for a bright, -1 for a dark blob. Covariance of the position in px^2 for image noise of one
/// grey level in 255, zero where it is not known.
struct Keypoint {
  float x_px = 0, y_px = 0, scale_px = 0, angle_rad = 0, response = 0;
  float cov_xx_px2 = 0, cov_xy_px2 = 0, cov_yy_px2 = 0;
  std::int32_t sign = 0;
  Eigen::Vector2d Position() const { return {x_px, y_px}; }
};

using Rgb = std::array<std::uint8_t, 3>;

/// Descriptor of any detector as 128 unsigned bytes whose Euclidean distances count. SIFT: norm about 512 (components
/// min(255, round(512 x))); shorter or signed ones as docs/decisions/0010 says.
using Descriptor = std::array<std::uint8_t, 128>;

/// Parallel arrays, one entry a feature.
struct ImageFeatures {
  std::vector<Keypoint> keypoints;
  std::vector<Descriptor> descriptors;
  std::vector<Rgb> colors;  ///< pixel under the keypoint, for coloured points
};

}  // namespace rilievo
