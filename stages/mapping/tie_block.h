// The tracks of a block laid out for mapping: sorted, flattened, undistorted once.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "base/ids.h"
#include "stages/mapping/mapping.h"

namespace rilievo::mapping {

/// One feature of a track.
struct TieRay {
  ImageId image;
  std::uint32_t feature = 0;
  std::uint32_t track = 0;
  Eigen::Vector2d measured_px = Eigen::Vector2d::Zero();
  Eigen::Vector2d normalized = Eigen::Vector2d::Zero();  ///< ideal coordinates X/Z, Y/Z
};

/// Rays of one track lie side by side, sorted by image; tracks are in the order of their elements.
struct TieBlock {
  std::vector<std::uint32_t> first_ray;  ///< per track, and one past the last
  std::vector<TieRay> rays;
  std::vector<std::vector<std::uint32_t>> rays_of_image;  ///< ray indices, ascending
  std::vector<double> focal_px;                           ///< per image

  std::size_t NumTracks() const { return first_ray.size() - 1; }
  std::size_t NumImages() const { return rays_of_image.size(); }
};

/// Does not depend on the order of the tracks or of their elements. Features that have no ray (beyond the distortion's
/// fold) are left out, tracks left with one ray too.
TieBlock MakeTieBlock(const Input& input);

}  // namespace rilievo::mapping
