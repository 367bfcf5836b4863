// Sorting and undistorting the tracks.
#include "stages/mapping/tie_block.h"

#include <algorithm>

#include "base/check.h"

namespace rilievo::mapping {

TieBlock MakeTieBlock(const Input& input) {
  const std::size_t images = input.block.images.size();
  RILIEVO_CHECK(input.keypoints.size() == images);
  std::vector<std::vector<FeatureRef>> sorted;
  sorted.reserve(input.tracks.size());
  for (const Track& track : input.tracks) {
    sorted.push_back(track.elements);
    std::sort(sorted.back().begin(), sorted.back().end());
  }
  std::sort(sorted.begin(), sorted.end());

  TieBlock block;
  block.first_ray.push_back(0);
  block.rays_of_image.resize(images);
  for (const Image& image : input.block.images)
    block.focal_px.push_back(input.block.camera_of(image.id).model.MeanFocal());
  for (const auto& elements : sorted) {
    const std::size_t begin = block.rays.size();
    const auto track = static_cast<std::uint32_t>(block.NumTracks());
    for (const FeatureRef& element : elements) {
      RILIEVO_CHECK(element.image.value < images && element.feature < input.keypoints[element.image.value].size());
      const Eigen::Vector2d measured_px = input.keypoints[element.image.value][element.feature].Position();
      const auto normalized = input.block.camera_of(element.image).model.Normalize(measured_px);
      if (normalized) block.rays.push_back({element.image, element.feature, track, measured_px, *normalized});
    }
    if (block.rays.size() < begin + 2) {
      block.rays.resize(begin);
      continue;
    }
    block.first_ray.push_back(static_cast<std::uint32_t>(block.rays.size()));
  }
  for (std::uint32_t i = 0; i < block.rays.size(); ++i) block.rays_of_image[block.rays[i].image.value].push_back(i);
  return block;
}

}  // namespace rilievo::mapping
