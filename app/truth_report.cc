// Aligns the largest component with the scene and prints what remains.
#include "app/truth_report.h"

#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>

#include "base/error.h"
#include "simulation/evaluation.h"
#include "simulation/renderer.h"
#include "simulation/scene.h"
#include "simulation/scene_source.h"

namespace rilievo::app {
namespace {

namespace fs = std::filesystem;

constexpr double kStrange = 0.05;  ///< of the object distance: no photograph is placed that badly by matching images

[[noreturn]] void FailNotThisScene(const std::string& scene_path, const std::string& why) {
  throw Error(ErrorCode::kInvalidInput, scene_path, "is not the scene of this run: " + why,
              "give the scene.json that lies beside the run's images");
}

/// Whatever can be compared without the images: names, sizes and, where the run was made from a scene file or inside a
/// simulated block, the scene itself. Images may be missing in the run (removed, quarantined), never be strange to the
/// scene.
void RequireSceneOfRun(const std::string& scene_path, const simulation::Scene& scene,
                       const scheduling::RunRecord& run) {
  const Block truth = simulation::SceneBlock(scene);
  std::map<std::string, const Image*> known;
  for (const Image& image : truth.images) known[image.name] = &image;
  for (const Image& image : run.block.images) {
    const auto found = known.find(image.name);
    if (found == known.end()) FailNotThisScene(scene_path, "it has no image " + image.name);
    const Image& rendered = *found->second;
    if (image.width_px != rendered.width_px || image.height_px != rendered.height_px)
      FailNotThisScene(scene_path, fmt::format("{} has {} x {} px in the run and {} x {} in the scene", image.name,
                                               image.width_px, image.height_px, rendered.width_px, rendered.height_px));
    if (run.from_scene && image.content != rendered.content)
      FailNotThisScene(scene_path, "the run was made from another scene file");
  }
  const fs::path folder = run.images.has_filename() ? run.images : run.images.parent_path();  // a/b/ and a/b alike
  const fs::path beside = folder.parent_path() / "scene.json";
  if (run.from_scene || !simulation::IsSceneFile(beside)) return;
  std::ifstream file(beside, std::ios::binary);
  if (std::string(std::istreambuf_iterator<char>(file), {}) != simulation::SceneText(scene))
    FailNotThisScene(scene_path, "the run's images belong to " + beside.string());
}

simulation::ModelErrors Evaluate(const std::string& scene_path, const scheduling::RunRecord& run,
                                 const OrientationResult& result, const ProgramContext& context) {
  const simulation::Scene scene = simulation::ReadSceneFile(scene_path);
  RequireSceneOfRun(scene_path, scene, run);
  if (result.models.empty())
    throw Error(ErrorCode::kInvalidInput, scene_path, "no image was oriented: there is nothing to compare");
  std::map<ImageId, std::string> names;
  for (const auto& [id, pose] : result.models.front().cam_from_world) names[id] = run.block.image(id).name;
  const simulation::Renderer renderer(scene);
  const auto errors = simulation::EvaluateModel(result.models.front(), names, renderer);
  if (!errors)
    throw Error(ErrorCode::kInvalidInput, scene_path, "an alignment with the truth needs three oriented images");
  if (errors->centers_m.rms > kStrange * errors->object_distance_m)
    PrintWarning(context, scene_path + ": the orientation does not resemble this scene at all: is it the right one?");
  return *errors;
}

nlohmann::json ToJson(const simulation::ErrorStatistics& s) {
  return {{"count", s.count}, {"mean", s.mean}, {"median", s.median}, {"rms", s.rms}, {"p95", s.p95}, {"max", s.max}};
}

}  // namespace

nlohmann::json TruthJson(const std::string& scene_path, const scheduling::RunRecord& run,
                         const OrientationResult& result, const ProgramContext& context) {
  const simulation::ModelErrors e = Evaluate(scene_path, run, result, context);
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

std::string TruthText(const std::string& scene_path, const scheduling::RunRecord& run, const OrientationResult& result,
                      const ProgramContext& context) {
  const simulation::ModelErrors e = Evaluate(scene_path, run, result, context);
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
