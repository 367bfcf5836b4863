// The matches of a pair as points for estimation: undistorted, one an image position, in random order.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "geometry/robust/two_view_problems.h"
#include "stages/verification/verification.h"

namespace rilievo::verification {

/// Matches of keypoints that share both positions (SIFT gives several with other angles) count once; a match whose
/// keypoint cannot be undistorted is left out. Distances are in pixels: the variances are 1 / focal_px^2 of each
/// camera.
struct Correspondences {
  PointPairs pairs;
  std::vector<std::uint32_t> matches;  ///< indices of matches, those of one pair of points together
  std::vector<std::uint32_t> begins;   ///< of each pair of points in `matches`, and the end of the last
  std::span<const std::uint32_t> MatchesOf(std::size_t i) const {
    return std::span(matches).subspan(begins[i], begins[i + 1] - begins[i]);
  }
};

/// The order depends on the matches and the seed only.
Correspondences MakeCorrespondences(const Input& input, std::uint64_t seed);

}  // namespace rilievo::verification
