// Writes the orientation report as text and JSON.
#include <cstdarg>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/units.h"
#include "block/io/camera_json.h"
#include "stages/reporting/orientation_report.h"
#include "stages/reporting/tie_report.h"

namespace rilievo::reporting {
namespace {

[[gnu::format(printf, 1, 2)]] std::string Format(const char* format, ...) {
  char line[512];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(line, sizeof line, format, arguments);
  va_end(arguments);
  return line;
}

std::string ModelText(const ModelReport& m, std::size_t index, std::size_t count, const Block& block,
                      const std::vector<ImageSummary>& images) {
  std::string text = count == 1 ? "Bundle block adjustment\n" : Format("Component %zu of %zu\n", index + 1, count);
  text += Format("  images %zu, object points %zu, rays %zu (mean multiplicity %.2f)\n", m.images.size(), m.points,
                 m.rays, m.mean_multiplicity);
  text += Format("  sigma0 %.3f px, redundancy %ld, RMS residual %.3f px, largest %.2f px\n", m.sigma0_px, m.redundancy,
                 m.rms_px, m.max_residual_px);
  text += Format("  intersection angles %.1f / %.1f / %.1f deg (least / mean / largest)\n", m.min_angle_deg,
                 m.mean_angle_deg, m.max_angle_deg);
  text += "  points by rays:";
  for (std::size_t k = 0; k < m.multiplicity.size(); ++k)
    text += Format(" %zu%s: %zu", k + 2, k == 7 ? "+" : "", m.multiplicity[k]);
  text += "\n  datum: free; origin at the mean of the projection centres, their mean distance from it is 1\n\n";
  text += "  features   cover      rays   cover   RMS x   RMS y     max  image\n";
  for (const ImageReport& i : m.images) {
    const ImageSummary& summary = images.at(i.image.value);
    text += Format("  %8u %5.1f %%  %8zu %5.1f %%  %6.3f  %6.3f  %6.2f  ", summary.features, 100 * summary.coverage,
                   i.rays, 100 * i.coverage, i.rms_x_px, i.rms_y_px, i.max_residual_px) +
            block.image(i.image).name + "\n";
  }
  return text;
}

const char* ModelName(TwoViewModel model) {
  switch (model) {
    case TwoViewModel::kRejected:
      return "rejected";
    case TwoViewModel::kEssential:
      return "essential";
    case TwoViewModel::kFundamental:
      return "fundamental";
    case TwoViewModel::kHomography:
      return "homography";
  }
  return "";
}

nlohmann::json ModelJson(const ModelReport& m, const Model& model, const Block& block) {
  nlohmann::json out = {
      {"points", m.points},
      {"rays", m.rays},
      {"mean_multiplicity", m.mean_multiplicity},
      {"sigma0_px", m.sigma0_px},
      {"redundancy", m.redundancy},
      {"rms_px", m.rms_px},
      {"max_residual_px", m.max_residual_px},
      {"intersection_angle_deg", {{"min", m.min_angle_deg}, {"mean", m.mean_angle_deg}, {"max", m.max_angle_deg}}},
      {"multiplicity_from_2", m.multiplicity},
      {"images", nlohmann::json::array()}};
  for (const ImageReport& i : m.images) {
    const Rigid3& pose = model.cam_from_world.at(i.image);
    const Eigen::Quaterniond& q = pose.rotation;
    out["images"].push_back({{"name", block.image(i.image).name},
                             {"rays", i.rays},
                             {"rms_x_px", i.rms_x_px},
                             {"rms_y_px", i.rms_y_px},
                             {"max_residual_px", i.max_residual_px},
                             {"coverage", i.coverage},
                             {"center", {i.center.x(), i.center.y(), i.center.z()}},
                             {"cam_from_world",
                              {{"quaternion_wxyz", {q.w(), q.x(), q.y(), q.z()}},
                               {"translation", {pose.translation.x(), pose.translation.y(), pose.translation.z()}}}}});
  }
  return out;
}

}  // namespace

std::string ToText(const Report& report, const Block& block, const OrientationResult& result,
                   const std::vector<std::string>& warnings) {
  std::string text = Format("Orientation: %zu of %zu images oriented", report.oriented, report.images);
  text += report.models.size() > 1 ? Format(" in %zu separate components\n", report.models.size()) : "\n";
  for (const auto& list : {warnings, result.warnings})
    for (const auto& warning : list) text += "  WARNING: " + warning + "\n";
  text += Format("  features %zu, pairs verified %zu of %zu, matches %zu of which %zu in verified pairs\n",
                 report.features, report.pairs_verified, report.pairs, report.matches, report.inliers);
  text += TieText(result.ties) + "\n";
  for (std::size_t k = 0; k < report.models.size(); ++k)
    text += ModelText(report.models[k], k, report.models.size(), block, result.images) + "\n";
  if (!result.unoriented.empty()) {
    text += "Not oriented\n";
    for (const auto& u : result.unoriented) {
      const ImageSummary& summary = result.images.at(u.image.value);
      text += "  " + block.image(u.image).name + ": " + u.reason +
              Format(" (%u features, cover %.1f %%)\n", summary.features, 100 * summary.coverage);
    }
    text += "\n";
  }
  if (!report.quarantined.empty()) {
    text += "Quarantined files\n";
    for (const auto& q : report.quarantined) text += "  " + q.name + ": " + q.reason + "\n";
    text += "\n";
  }
  return text;
}

nlohmann::json ToJson(const Report& report, const Block& block, const OrientationResult& result,
                      const std::vector<std::string>& warnings) {
  std::vector<std::string> all_warnings = warnings;
  all_warnings.insert(all_warnings.end(), result.warnings.begin(), result.warnings.end());
  nlohmann::json out = {{"format", "rilievo-orientation-report"},
                        {"version", 1},
                        {"images", report.images},
                        {"oriented", report.oriented},
                        {"features", report.features},
                        {"pairs", report.pairs},
                        {"pairs_verified", report.pairs_verified},
                        {"matches", report.matches},
                        {"inliers", report.inliers},
                        {"tie_points", TieJson(result.ties)},
                        {"warnings", all_warnings},
                        {"models", nlohmann::json::array()},
                        {"unoriented", nlohmann::json::array()},
                        {"quarantined", nlohmann::json::array()},
                        {"image_list", nlohmann::json::array()},
                        {"pair_list", nlohmann::json::array()},
                        {"cameras", nlohmann::json::array()}};
  for (std::size_t k = 0; k < report.models.size(); ++k)
    out["models"].push_back(ModelJson(report.models[k], result.models[k], block));
  for (const auto& u : result.unoriented)
    out["unoriented"].push_back({{"name", block.image(u.image).name}, {"reason", u.reason}});
  for (const auto& q : report.quarantined) out["quarantined"].push_back({{"name", q.name}, {"reason", q.reason}});
  for (const Image& image : block.images)
    out["image_list"].push_back({{"name", image.name},
                                 {"camera", image.camera_id.value},
                                 {"width_px", image.width_px},
                                 {"height_px", image.height_px},
                                 {"features", result.images.at(image.id.value).features},
                                 {"feature_coverage", result.images.at(image.id.value).coverage}});
  for (const Camera& c : block.cameras) {
    nlohmann::json camera = io::CameraModelJson(c.model);
    camera["label"] = c.label;
    camera["width_px"] = c.width_px;
    camera["height_px"] = c.height_px;
    out["cameras"].push_back(std::move(camera));
  }
  for (const auto& p : result.pairs)
    out["pair_list"].push_back({{"first", block.image(p.pair.first).name},
                                {"second", block.image(p.pair.second).name},
                                {"model", ModelName(p.model)},
                                {"reason", rilievo::ToText(p.reason)},
                                {"matches", p.matches},
                                {"inliers", p.inliers},
                                {"median_angle_deg", RadToDeg(p.median_angle_rad)},
                                {"homography_ratio", p.homography_ratio}});
  return out;
}

}  // namespace rilievo::reporting
