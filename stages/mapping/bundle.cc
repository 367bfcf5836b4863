// Choice of points and images for the adjustments on the way.
#include "stages/mapping/bundle.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace rilievo::mapping {
namespace {

constexpr int kCells = 400;
constexpr std::size_t kNeighbours = 6;

/// Registered images by falling number of points shared with `image`.
std::vector<ImageId> BestConnected(const Reconstruction& model, ImageId image, std::size_t most) {
  const TieBlock& ties = model.ties();
  std::map<ImageId, int> shared;
  for (const std::uint32_t ray : ties.rays_of_image[image.value]) {
    if (!model.IsUsed(ray)) continue;
    const std::uint32_t track = ties.rays[ray].track;
    for (std::uint32_t other = ties.first_ray[track]; other < ties.first_ray[track + 1]; ++other)
      if (model.IsUsed(other) && ties.rays[other].image != image) ++shared[ties.rays[other].image];
  }
  std::vector<std::pair<int, ImageId>> ranked;
  for (const auto& [other, count] : shared) ranked.emplace_back(-count, other);
  std::sort(ranked.begin(), ranked.end());
  std::vector<ImageId> best;
  for (std::size_t i = 0; i < std::min(most, ranked.size()); ++i) best.push_back(ranked[i].second);
  return best;
}

}  // namespace

std::vector<std::uint32_t> CarryingTracks(const Block& block, const Reconstruction& model,
                                          std::span<const ImageId> images, int cells) {
  const TieBlock& ties = model.ties();
  struct Grid {
    double cell_px = 1;
    int columns = 0;
    std::vector<std::uint8_t> taken;
  };
  std::vector<Grid> grids(ties.NumImages());
  std::vector<std::uint8_t> is_candidate(ties.NumTracks(), 0);
  for (const ImageId image : images) {
    const Camera& camera = block.camera_of(image);
    Grid& grid = grids[image.value];
    grid.cell_px = std::max(1.0, std::sqrt(static_cast<double>(camera.width_px) * camera.height_px / cells));
    grid.columns = static_cast<int>(camera.width_px / grid.cell_px) + 1;
    grid.taken.assign(
        static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(camera.height_px / grid.cell_px + 1), 0);
    for (const std::uint32_t ray : ties.rays_of_image[image.value])
      if (model.IsUsed(ray)) is_candidate[ties.rays[ray].track] = 1;
  }
  std::vector<std::pair<int, std::uint32_t>> ranked;  // most rays first, then by track
  for (std::uint32_t track = 0; track < ties.NumTracks(); ++track)
    if (is_candidate[track]) ranked.emplace_back(-model.NumUsedRays(track), track);
  std::sort(ranked.begin(), ranked.end());

  std::vector<std::uint32_t> chosen;
  for (const auto& [rays, track] : ranked) {
    bool fills = false;
    for (std::uint32_t ray = ties.first_ray[track]; ray < ties.first_ray[track + 1]; ++ray) {
      Grid& grid = grids[ties.rays[ray].image.value];
      if (!model.IsUsed(ray) || grid.taken.empty()) continue;
      const Eigen::Vector2d cell = (ties.rays[ray].measured_px / grid.cell_px).cwiseMax(0);
      const auto at = std::min(static_cast<std::size_t>(cell.y()) * static_cast<std::size_t>(grid.columns) +
                                   static_cast<std::size_t>(cell.x()),
                               grid.taken.size() - 1);
      fills |= grid.taken[at] == 0;
      grid.taken[at] = 1;
    }
    if (fills) chosen.push_back(track);
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

Model ToModel(const Reconstruction& reconstruction, std::span<const std::uint32_t> tracks) {
  const TieBlock& ties = reconstruction.ties();
  Model model;
  model.points.reserve(tracks.size());
  for (const std::uint32_t track : tracks) {
    Point& point = model.points.emplace_back();
    point.position = reconstruction.position(track);
    for (std::uint32_t ray = ties.first_ray[track]; ray < ties.first_ray[track + 1]; ++ray) {
      if (!reconstruction.IsUsed(ray)) continue;
      const TieRay& tie = ties.rays[ray];
      point.observations.push_back({{tie.image, tie.feature}, tie.measured_px, Eigen::Vector2d::Zero()});
      model.cam_from_world.try_emplace(tie.image, reconstruction.cam_from_world(tie.image));
    }
  }
  return model;
}

adjustment::Summary Adjust(const Block& block, Reconstruction& reconstruction, std::span<const std::uint32_t> tracks,
                           const adjustment::Options& options, RunContext& context) {
  Model model = ToModel(reconstruction, tracks);
  const adjustment::Summary summary = adjustment::Run(block, model, options, context);
  for (const auto& [image, pose] : model.cam_from_world)
    if (!options.fixed_images.contains(image)) reconstruction.SetPose(image, pose);
  for (std::size_t i = 0; i < tracks.size(); ++i) reconstruction.SetPosition(tracks[i], model.points[i].position);
  return summary;
}

void AdjustLocally(const Block& block, Reconstruction& reconstruction, ImageId image, double loss_scale_px,
                   RunContext& context) {
  const std::vector<ImageId> neighbours = BestConnected(reconstruction, image, kNeighbours);
  std::set<ImageId> local(neighbours.begin(), neighbours.end());
  local.insert(image);
  const std::vector<ImageId> only{image};
  const auto tracks = CarryingTracks(block, reconstruction, only, kCells);
  adjustment::Options options;
  options.loss = adjustment::Loss::kCauchy;
  options.loss_scale_px = loss_scale_px;
  options.max_iterations = 15;
  options.function_tolerance = 1e-4;
  for (const ImageId registered : reconstruction.RegisteredImages())
    if (!local.contains(registered)) options.fixed_images.insert(registered);
  Adjust(block, reconstruction, tracks, options, context);
  std::set<std::uint32_t> seen;
  const TieBlock& ties = reconstruction.ties();
  for (const ImageId moved : local)
    for (const std::uint32_t ray : ties.rays_of_image[moved.value])
      if (reconstruction.IsUsed(ray)) seen.insert(ties.rays[ray].track);
  for (const std::uint32_t track : seen) reconstruction.Refine(track);
}

void AdjustGlobally(const Block& block, Reconstruction& reconstruction, const GlobalAdjustment& how,
                    RunContext& context) {
  const std::vector<ImageId> images = reconstruction.RegisteredImages();
  const auto tracks = CarryingTracks(block, reconstruction, images, how.cells);
  adjustment::Options options;
  options.loss = adjustment::Loss::kCauchy;
  options.loss_scale_px = how.loss_scale_px;
  options.max_iterations = 30;
  options.function_tolerance = how.function_tolerance;
  Adjust(block, reconstruction, tracks, options, context);
  for (const std::uint32_t track : reconstruction.Tracks()) reconstruction.Refine(track);
}

}  // namespace rilievo::mapping
