// Gathers the figures of an orientation.
#include "stages/reporting/orientation_report.h"

#include <algorithm>
#include <cmath>

#include "base/units.h"
#include "block/coverage.h"

namespace rilievo::reporting {
namespace {

/// Largest angle between any two rays of a point, in degrees.
double LargestAngleDeg(const Model& model, const Point& point) {
  std::vector<Eigen::Vector3d> rays;
  for (const Observation& o : point.observations)
    rays.push_back((point.position - model.cam_from_world.at(o.feature.image).Center()).normalized());
  double smallest_cosine = 1;
  for (std::size_t i = 0; i < rays.size(); ++i)
    for (std::size_t j = i + 1; j < rays.size(); ++j) smallest_cosine = std::min(smallest_cosine, rays[i].dot(rays[j]));
  return RadToDeg(std::acos(std::clamp(smallest_cosine, -1.0, 1.0)));
}

struct ImageSums {
  explicit ImageSums(const Image& image) : cells(image.width_px, image.height_px) {}
  double xx = 0, yy = 0, largest = 0;
  std::size_t rays = 0;
  CoverageGrid cells;
};

void AddRay(ImageSums& sums, const Observation& o) {
  const Eigen::Vector2d& v = o.residual_px;
  sums.xx += v.x() * v.x();
  sums.yy += v.y() * v.y();
  sums.largest = std::max(sums.largest, v.norm());
  ++sums.rays;
  sums.cells.Add(o.measured_px);
}

ModelReport SummarizeModel(const Block& block, const Model& model) {
  ModelReport report;
  std::map<ImageId, ImageSums> sums;
  for (const auto& [id, pose] : model.cam_from_world) sums.emplace(id, block.image(id));
  double angle_sum_deg = 0, square_sum = 0;
  report.min_angle_deg = model.points.empty() ? 0 : 180;
  for (const Point& point : model.points) {
    const double angle_deg = LargestAngleDeg(model, point);
    angle_sum_deg += angle_deg;
    report.min_angle_deg = std::min(report.min_angle_deg, angle_deg);
    report.max_angle_deg = std::max(report.max_angle_deg, angle_deg);
    report.rays += point.observations.size();
    if (point.observations.size() >= 2) ++report.multiplicity[std::min<std::size_t>(point.observations.size() - 2, 7)];
    for (const Observation& o : point.observations) {
      AddRay(sums.at(o.feature.image), o);
      square_sum += o.residual_px.squaredNorm();
      report.max_residual_px = std::max(report.max_residual_px, o.residual_px.norm());
    }
  }
  report.points = model.points.size();
  report.sigma0_px = model.sigma0_px;
  report.redundancy = model.redundancy;
  if (report.points > 0) {
    report.mean_multiplicity = static_cast<double>(report.rays) / static_cast<double>(report.points);
    report.mean_angle_deg = angle_sum_deg / static_cast<double>(report.points);
    report.rms_px = std::sqrt(square_sum / static_cast<double>(2 * report.rays));
  }
  for (const auto& [id, s] : sums) {
    const double n = static_cast<double>(std::max<std::size_t>(s.rays, 1));
    report.images.push_back({id, s.rays, std::sqrt(s.xx / n), std::sqrt(s.yy / n), s.largest, s.cells.Share(),
                             model.cam_from_world.at(id).Center()});
  }
  return report;
}

}  // namespace

Report Summarize(const Block& block, const OrientationResult& result) {
  Report report;
  report.quarantined = block.quarantined;
  for (const Image& image : block.images) {
    const ImageSummary& summary = result.images.at(image.id.value);
    report.features += summary.features;
    if (summary.quarantine.empty())
      ++report.images;
    else
      report.quarantined.push_back({image.name, summary.quarantine});
  }
  for (const auto& pair : result.pairs) {
    ++report.pairs;
    report.matches += pair.matches;
    if (pair.model == TwoViewModel::kRejected) continue;
    ++report.pairs_verified;
    report.inliers += pair.inliers;
  }
  for (const Model& model : result.models) {
    report.models.push_back(SummarizeModel(block, model));
    report.oriented += model.cam_from_world.size();
  }
  return report;
}

}  // namespace rilievo::reporting
