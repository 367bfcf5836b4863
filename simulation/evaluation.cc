// Alignment and error statistics.
#include "simulation/evaluation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "base/units.h"

namespace rilievo::simulation {
namespace {

using Vectors = std::vector<Eigen::Vector3d>;

double Median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

ErrorStatistics Statistics(std::vector<double> errors) {
  ErrorStatistics s;
  s.count = errors.size();
  if (errors.empty()) return s;
  std::sort(errors.begin(), errors.end());
  double squares = 0;
  for (const double error : errors) s.mean += error, squares += error * error;
  const auto n = static_cast<double>(errors.size());
  s.mean /= n;
  s.rms = std::sqrt(squares / n);
  s.median = Median(errors);
  s.p95 = errors[static_cast<std::size_t>(std::ceil(0.95 * n)) - 1];
  s.max = errors.back();
  return s;
}

std::vector<double> Distances(const Similarity3& b_from_a, const Vectors& x_in_a, const Vectors& x_in_b) {
  std::vector<double> distances;
  for (std::size_t i = 0; i < x_in_a.size(); ++i) distances.push_back((b_from_a * x_in_a[i] - x_in_b[i]).norm());
  return distances;
}

/// Least squares, then twice more without the points beyond three medians.
std::optional<Similarity3> FitTrimmed(const Vectors& x_in_a, const Vectors& x_in_b) {
  auto fit = FitSimilarity(x_in_a, x_in_b);
  for (int round = 0; round < 2 && fit; ++round) {
    const auto distances = Distances(*fit, x_in_a, x_in_b);
    const double limit = 3 * Median(distances);
    Vectors kept_a, kept_b;
    for (std::size_t i = 0; i < distances.size(); ++i)
      if (distances[i] <= limit) kept_a.push_back(x_in_a[i]), kept_b.push_back(x_in_b[i]);
    fit = FitSimilarity(kept_a, kept_b);
  }
  return fit;
}

class Evaluation {
 public:
  Evaluation(const Model& model, const std::map<ImageId, std::string>& names, const Renderer& renderer)
      : model_(model), renderer_(renderer) {
    const auto& known = renderer.scene().names;
    for (const auto& [id, pose] : model.cam_from_world) {
      const auto name = names.find(id);
      const auto found = name == names.end() ? known.end() : std::find(known.begin(), known.end(), name->second);
      if (found == known.end())
        throw Error(ErrorCode::kInvalidInput, name == names.end() ? "image " + std::to_string(id.value) : name->second,
                    "is not an image of the scene", "compare with the scene that the images were rendered from");
      index_[id] = static_cast<std::size_t>(found - known.begin());
    }
  }

  std::optional<ModelErrors> Run() const {
    ModelErrors errors;
    Vectors model_centers, true_centers;
    for (const auto& [id, index] : index_) {
      model_centers.push_back(model_.cam_from_world.at(id).Center());
      true_centers.push_back(TruePose(index).Center());
    }
    const auto fit = FitSimilarity(model_centers, true_centers);
    if (!fit) return std::nullopt;
    errors.truth_from_model = *fit;
    errors.centers_m = Statistics(Distances(*fit, model_centers, true_centers));
    errors.rotations_deg = Rotations(*fit);
    errors.object_distance_m = ObjectDistance();
    errors.center_relative = errors.centers_m.mean > 0 ? errors.object_distance_m / errors.centers_m.mean
                                                       : std::numeric_limits<double>::infinity();
    ComparePoints(errors);
    return errors;
  }

 private:
  const Rigid3& TruePose(std::size_t index) const { return renderer_.scene().cam_from_world[index]; }

  ErrorStatistics Rotations(const Similarity3& truth_from_model) const {
    std::vector<double> angles_deg;
    for (const auto& [id, index] : index_) {
      const Rigid3 aligned = TransformPose(truth_from_model, model_.cam_from_world.at(id));
      // |vec| and w by atan2: acos loses angles below 1e-8
      const Eigen::Quaterniond turn = aligned.rotation * TruePose(index).rotation.conjugate();
      angles_deg.push_back(RadToDeg(2 * std::atan2(turn.vec().norm(), std::abs(turn.w()))));
    }
    return Statistics(std::move(angles_deg));
  }

  double ObjectDistance() const {
    double sum = 0;
    for (const auto& [id, index] : index_) {
      const CameraModel& camera = renderer_.scene().camera.model;
      const auto seen = renderer_.SurfacePoint(index, {camera.cx, camera.cy});
      sum += seen ? (*seen - TruePose(index).Center()).norm() : renderer_.scene().options.distance_m;
    }
    return sum / static_cast<double>(index_.size());
  }

  std::optional<Eigen::Vector3d> TruePoint(const Point& point) const {
    std::array<std::vector<double>, 3> axes;
    for (const Observation& observation : point.observations) {
      const auto image = index_.find(observation.feature.image);
      if (image == index_.end()) continue;
      const auto hit = renderer_.SurfacePoint(image->second, observation.measured_px);
      for (int k = 0; hit && k < 3; ++k) axes[k].push_back((*hit)[k]);
    }
    if (axes[0].empty()) return std::nullopt;
    return Eigen::Vector3d(Median(axes[0]), Median(axes[1]), Median(axes[2]));
  }

  void ComparePoints(ModelErrors& errors) const {
    Vectors model_points, true_points;
    std::vector<double> to_surface_m;
    for (const Point& point : model_.points) {
      const Eigen::Vector3d aligned = errors.truth_from_model * point.position;
      // Twice the farthest that the surface can lie: the query always finds it.
      const double radius_m = 2 * (aligned.norm() + 100 * renderer_.scene().options.distance_m);
      if (const auto nearest = renderer_.ClosestPoint(aligned, radius_m))
        to_surface_m.push_back((*nearest - aligned).norm());
      if (const auto truth = TruePoint(point)) {
        model_points.push_back(point.position);
        true_points.push_back(*truth);
      } else {
        ++errors.points_without_truth;
      }
    }
    errors.surface_m = Statistics(std::move(to_surface_m));
    errors.points_m = Statistics(Distances(errors.truth_from_model, model_points, true_points));
    if (const auto own = FitTrimmed(model_points, true_points))
      errors.points_own_datum_m = Statistics(Distances(*own, model_points, true_points));
  }

  const Model& model_;
  const Renderer& renderer_;
  std::map<ImageId, std::size_t> index_;
};

}  // namespace

std::optional<ModelErrors> EvaluateModel(const Model& model, const std::map<ImageId, std::string>& image_names,
                                         const Renderer& renderer) {
  return Evaluation(model, image_names, renderer).Run();
}

}  // namespace rilievo::simulation
