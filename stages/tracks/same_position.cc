// Sweeps the features from left to right.
#include "stages/tracks/same_position.h"

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <tuple>

namespace rilievo::tracks {

std::vector<std::uint32_t> RepresentativeFeatures(std::span<const Keypoint> keypoints) {
  std::vector<std::uint32_t> order(keypoints.size());
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::tuple(keypoints[a].x_px, keypoints[a].y_px, a) < std::tuple(keypoints[b].x_px, keypoints[b].y_px, b);
  });
  std::vector<std::uint32_t> result(keypoints.size());
  std::vector<std::uint32_t> standing;  // for themselves, by x
  std::size_t window = 0;               // the first of them that is near enough in x
  for (const std::uint32_t feature : order) {
    const Eigen::Vector2d position = keypoints[feature].Position();
    while (window < standing.size() && keypoints[standing[window]].Position().x() < position.x() - kSamePosition_px)
      ++window;
    const auto found = std::find_if(
        standing.begin() + static_cast<std::ptrdiff_t>(window), standing.end(),
        [&](std::uint32_t other) { return (keypoints[other].Position() - position).norm() <= kSamePosition_px; });
    result[feature] = found == standing.end() ? feature : *found;
    if (found == standing.end()) standing.push_back(feature);
  }
  return result;
}

}  // namespace rilievo::tracks
