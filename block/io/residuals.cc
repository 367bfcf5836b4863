// Reprojection residuals of a model's observations, computed anew.
#include "block/io/residuals.h"

#include <cmath>

namespace rilievo::io {

std::optional<Eigen::Vector2d> ResidualPx(const Block& block, const Model& model, const Point& point,
                                          const Observation& observation) {
  const auto pose = model.cam_from_world.find(observation.feature.image);
  if (pose == model.cam_from_world.end()) return std::nullopt;
  const auto projected = block.camera_of(observation.feature.image).model.Project(pose->second * point.position);
  if (!projected) return std::nullopt;
  return *projected - observation.measured_px;
}

double RmsResidualPx(const Block& block, const Model& model, const Point& point) {
  double sum = 0;
  int count = 0;
  for (const Observation& observation : point.observations) {
    if (const auto residual = ResidualPx(block, model, point, observation)) {
      sum += residual->squaredNorm();
      ++count;
    }
  }
  return count == 0 ? 0 : std::sqrt(sum / count);
}

}  // namespace rilievo::io
