// Aligns the largest component with the scene and prints what remains.
#include "app/truth_report.h"

#include <fmt/format.h>

#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/error.h"
#include "simulation/evaluation.h"
#include "simulation/renderer.h"
#include "simulation/scene.h"

namespace rilievo::app {
namespace {

simulation::ModelErrors Evaluate(const std::string& scene_path, const Block& block, const OrientationResult& result) {
  const simulation::Scene scene = simulation::ReadSceneFile(scene_path);
  if (result.models.empty())
    throw Error(ErrorCode::kInvalidInput, scene_path, "no image was oriented: there is nothing to compare");
  std::map<ImageId, std::string> names;
  for (const auto& [id, pose] : result.models.front().cam_from_world) names[id] = block.image(id).name;
  const simulation::Renderer renderer(scene);
  const auto errors = simulation::EvaluateModel(result.models.front(), names, renderer);
  if (!errors)
    throw Error(ErrorCode::kInvalidInput, scene_path, "an alignment with the truth needs three oriented images");
  return *errors;
}

nlohmann::json ToJson(const simulation::ErrorStatistics& s) {
  return {{"count", s.count}, {"mean", s.mean}, {"median", s.median}, {"rms", s.rms}, {"p95", s.p95}, {"max", s.max}};
}

}  // namespace

nlohmann::json TruthJson(const std::string& scene_path, const Block& block, const OrientationResult& result) {
  const simulation::ModelErrors e = Evaluate(scene_path, block, result);
  return {{"images", e.centers_m.count},
          {"object_distance_m", e.object_distance_m},
          {"mean_centre_error_m", e.centers_m.mean},
          {"mean_centre_error_relative", e.centers_m.mean / e.object_distance_m},
          {"points", result.models.front().points.size()},
          {"points_without_truth", e.points_without_truth},
          {"centers_m", ToJson(e.centers_m)},
          {"rotations_deg", ToJson(e.rotations_deg)},
          {"points_m", ToJson(e.points_m)},
          {"points_own_datum_m", ToJson(e.points_own_datum_m)},
          {"surface_m", ToJson(e.surface_m)}};
}

std::string TruthText(const std::string& scene_path, const Block& block, const OrientationResult& result) {
  const simulation::ModelErrors e = Evaluate(scene_path, block, result);
  const auto line = [](const char* what, const simulation::ErrorStatistics& s, double factor, const char* unit) {
    return fmt::format("  {:<44} {:>7}  mean {:.4f}  median {:.4f}  RMS {:.4f}  95 % {:.4f}  largest {:.4f} {}\n", what,
                       s.count, s.mean * factor, s.median * factor, s.rms * factor, s.p95 * factor, s.max * factor,
                       unit);
  };
  return "Errors against the exact truth (seven-parameter alignment of the projection centres)\n" +
         line("projection centres", e.centers_m, 1000, "mm") + line("rotations", e.rotations_deg, 1, "deg") +
         line("object points against their true points", e.points_m, 1000, "mm") +
         line("object points, aligned on themselves", e.points_own_datum_m, 1000, "mm") +
         line("object points against the surface", e.surface_m, 1000, "mm") +
         fmt::format("  mean centre error 1 : {:.0f} of the object distance ({:.3f} m)\n", e.center_relative,
                     e.object_distance_m);
}

}  // namespace rilievo::app
