// Compares verified pairs with the finished models.
#include "stages/mapping/doubts.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <tuple>
#include <utility>

#include "base/units.h"
#include "geometry/epipolar.h"
#include "geometry/triangulation.h"

namespace rilievo::mapping {
namespace {

constexpr std::size_t kStrongPair = 30;  ///< verified matches: the strict bar of a resection
constexpr double kContradicted = 0.5;    ///< a pair of a smaller share than this contradicts the model
constexpr double kDoubtfulModel = 0.75;  ///< so many of all verified matches should agree
constexpr std::size_t kFewRays = 30;
constexpr std::size_t kMostLines = 10;  ///< of a kind

std::string Percent(double share) { return std::to_string(std::lround(100 * share)) + " %"; }

std::string Degrees(double angle_rad) {
  const long tenths = std::lround(10 * RadToDeg(angle_rad));
  return std::to_string(tenths / 10) + "." + std::to_string(tenths % 10) + " deg";
}

/// Which object point each feature has a ray of: 0 = none, else the point's index + 1. By image, then feature.
std::vector<std::vector<std::uint32_t>> PointsOfFeatures(const Input& input, const Model& model) {
  std::vector<std::vector<std::uint32_t>> points(input.keypoints.size());
  for (const auto& [image, pose] : model.cam_from_world)
    points[image.value].assign(input.keypoints[image.value].size(), 0);
  for (std::uint32_t p = 0; p < model.points.size(); ++p)
    for (const Observation& o : model.points[p].observations)
      if (!points[o.feature.image.value].empty()) points[o.feature.image.value][o.feature.feature] = p + 1;
  return points;
}

/// One image of a pair as the test of its matches wants it.
struct View {
  const CameraModel& camera;
  std::span<const Keypoint> keypoints;
  const std::vector<std::uint32_t>& points;
  CameraPose pose;

  /// Distance of the projected point from the feature; infinite behind the camera or beyond the distortion's fold.
  double ResidualPx(const Point& point, std::uint32_t feature) const {
    const auto at = camera.Normalize(keypoints[feature].Position());
    return at ? RayResidualPx({&pose, *at, camera.MeanFocal()}, point.position)
              : std::numeric_limits<double>::infinity();
  }
};

View MakeView(const Input& input, const Model& model, const std::vector<std::vector<std::uint32_t>>& points,
              ImageId id) {
  return {input.block.camera_of(id).model, input.keypoints[id.value], points[id.value],
          CameraPose(model.cam_from_world.at(id))};
}

bool Agrees(const Model& model, const View& first, const View& second, const Eigen::Matrix3d& essential,
            const CoordinateVariances& variances, const Match& match, double max_residual_px) {
  const std::uint32_t p = first.points[match.first], q = second.points[match.second];
  if (p > 0 && second.ResidualPx(model.points[p - 1], match.second) > max_residual_px) return false;
  if (q > 0 && q != p && first.ResidualPx(model.points[q - 1], match.first) > max_residual_px) return false;
  if (p > 0 || q > 0) return true;
  const auto x = first.camera.Normalize(first.keypoints[match.first].Position());
  const auto y = second.camera.Normalize(second.keypoints[match.second].Position());
  // Negated so that the 0 / 0 of two coinciding projection centres counts as agreement: they have no epipolar lines.
  return x && y && !(SquaredSampson(essential, *x, *y, variances) > max_residual_px * max_residual_px);
}

/// Pairs that are well supported by themselves and yet do not fit the model.
std::vector<std::string> ContradictionLines(const Block& block, std::vector<PairAgreement> agreements) {
  std::erase_if(agreements,
                [](const PairAgreement& a) { return a.verified < kStrongPair || a.Share() >= kContradicted; });
  std::sort(agreements.begin(), agreements.end(), [](const PairAgreement& a, const PairAgreement& b) {
    return std::tuple(b.verified - b.agreeing, a.pair) < std::tuple(a.verified - a.agreeing, b.pair);
  });
  std::vector<std::string> lines;
  for (const PairAgreement& a : agreements) {
    if (lines.size() == kMostLines) {
      lines.push_back(std::to_string(agreements.size() - kMostLines) + " more pairs contradict the orientation");
      break;
    }
    std::string line = block.image(a.pair.first).name + " and " + block.image(a.pair.second).name +
                       " contradict the orientation: " + std::to_string(a.agreeing) + " of " +
                       std::to_string(a.verified) + " verified matches agree with it";
    if (a.rotation_rad > DegToRad(1)) line += ", the relative orientation differs by " + Degrees(a.rotation_rad);
    lines.push_back(
        line + ": repeated structures, moving objects, a wrong calibration, or one of the two is in a wrong place");
  }
  return lines;
}

std::vector<std::string> WeakImageLines(const Block& block, const Model& model) {
  std::map<ImageId, std::size_t> rays;
  for (const auto& [image, pose] : model.cam_from_world) rays[image] = 0;
  for (const Point& point : model.points)
    for (const Observation& o : point.observations) ++rays[o.feature.image];
  std::vector<std::pair<std::size_t, ImageId>> weak;
  for (const auto& [image, count] : rays)
    if (count < kFewRays) weak.emplace_back(count, image);
  std::sort(weak.begin(), weak.end());
  std::vector<std::string> lines;
  for (const auto& [count, image] : weak) {
    if (lines.size() == kMostLines) {
      lines.push_back(std::to_string(weak.size() - kMostLines) + " more images are held by few rays");
      break;
    }
    lines.push_back(block.image(image).name + " is held by " + std::to_string(count) +
                    " rays only: check its place, or take images between it and its neighbours");
  }
  return lines;
}

std::string NameOf(std::size_t model, std::size_t models) {
  return models > 1 ? "component " + std::to_string(model + 1) : std::string("the orientation");
}

/// Strong pairs whose images ended in two different models, one line for two models.
std::vector<std::string> SplitLines(const Block& block, std::span<const TwoViewGeometry> pairs,
                                    std::span<const Model> models) {
  std::map<ImageId, std::size_t> model_of;
  for (std::size_t m = 0; m < models.size(); ++m)
    for (const auto& [image, pose] : models[m].cam_from_world) model_of.emplace(image, m);
  struct Link {
    std::size_t pairs = 0, most = 0;
    ImagePair strongest;
  };
  std::map<std::pair<std::size_t, std::size_t>, Link> links;
  for (const TwoViewGeometry& g : pairs) {
    const auto a = model_of.find(g.pair.first), b = model_of.find(g.pair.second);
    if (!g.IsVerified() || g.inliers.size() < kStrongPair || a == model_of.end() || b == model_of.end()) continue;
    if (a->second == b->second) continue;
    Link& link = links[std::minmax(a->second, b->second)];
    ++link.pairs;
    if (g.inliers.size() > link.most) link.most = g.inliers.size(), link.strongest = g.pair;
  }
  std::vector<std::string> lines;
  for (const auto& [two, link] : links) {
    if (lines.size() == kMostLines) break;
    lines.push_back("components " + std::to_string(two.first + 1) + " and " + std::to_string(two.second + 1) +
                    " could not be joined although " + std::to_string(link.pairs) +
                    " verified pairs connect them (best: " + std::to_string(link.most) + " matches of " +
                    block.image(link.strongest.first).name + " and " + block.image(link.strongest.second).name +
                    "): take images between them");
  }
  return lines;
}

}  // namespace

std::vector<PairAgreement> Agreements(const Input& input, std::span<const TwoViewGeometry> pairs, const Model& model,
                                      double max_residual_px) {
  const auto points = PointsOfFeatures(input, model);
  std::vector<PairAgreement> agreements;
  for (const TwoViewGeometry& g : pairs) {
    if (!g.IsVerified() || g.inliers.empty()) continue;
    const auto first_pose = model.cam_from_world.find(g.pair.first),
               second_pose = model.cam_from_world.find(g.pair.second);
    if (first_pose == model.cam_from_world.end() || second_pose == model.cam_from_world.end()) continue;
    const View first = MakeView(input, model, points, g.pair.first),
               second = MakeView(input, model, points, g.pair.second);
    const Rigid3 second_from_first = second_pose->second * first_pose->second.Inverse();
    const Eigen::Matrix3d essential = EssentialFromPose(second_from_first);
    const double f = first.camera.MeanFocal(), s = second.camera.MeanFocal();
    PairAgreement agreement{g.pair, 0, g.inliers.size(), 0};
    for (const Match& match : g.inliers)
      agreement.agreeing += Agrees(model, first, second, essential, {1 / (f * f), 1 / (s * s)}, match, max_residual_px);
    const bool has_pose =
        g.model == TwoViewModel::kEssential || (g.model == TwoViewModel::kHomography && g.median_angle_rad > 0);
    if (has_pose) agreement.rotation_rad = g.second_from_first.rotation.angularDistance(second_from_first.rotation);
    agreements.push_back(agreement);
  }
  return agreements;
}

std::vector<std::string> Doubts(const Input& input, std::span<const TwoViewGeometry> pairs,
                                std::span<const Model> models, double max_residual_px) {
  std::vector<std::string> doubts;
  const auto add = [&](std::vector<std::string> lines) {
    for (std::string& line : lines) doubts.push_back(std::move(line));
  };
  for (std::size_t m = 0; m < models.size(); ++m) {
    const auto agreements = Agreements(input, pairs, models[m], max_residual_px);
    std::size_t agreeing = 0, verified = 0;
    for (const PairAgreement& a : agreements) agreeing += a.agreeing, verified += a.verified;
    if (static_cast<double>(agreeing) < kDoubtfulModel * static_cast<double>(verified))
      doubts.push_back("only " + Percent(static_cast<double>(agreeing) / static_cast<double>(verified)) +
                       " of the verified matches agree with " + NameOf(m, models.size()) +
                       ": the calibration may not be that of these images");
    add(ContradictionLines(input.block, agreements));
    add(WeakImageLines(input.block, models[m]));
  }
  add(SplitLines(input.block, pairs, models));
  return doubts;
}

}  // namespace rilievo::mapping
