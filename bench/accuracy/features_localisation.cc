// How well matched features hit the same point: epipolar errors in rendered blocks, by the exact truth.
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <string>

#include "base/error.h"
#include "bench/accuracy/features_detectors.h"
#include "bench/accuracy/features_eval.h"
#include "geometry/epipolar.h"
#include "simulation/renderer.h"
#include "stages/matching/matching.h"

namespace rilievo::bench {
namespace {

using simulation::Renderer;

/// A match is correct within these: both distances to the epipolar lines, and the distance to where the true surface
/// point of the first feature appears in the second image.
constexpr double kEpipolarGate_px = 3, kSurfaceGate_px = 5;

/// A correct match and its errors.
struct Correct {
  std::size_t first_image = 0, second_image = 0;
  Eigen::Vector2d first_px, second_px;
  double scale_px = 0;                             ///< of the first feature
  double response = 0;                             ///< the lesser of the two
  double first_error_px = 0, second_error_px = 0;  ///< distances to the epipolar lines in the two images
  double surface_error_px = 0;                     ///< distance to the surface point's image in the second
};

/// Matches of a detector in a block: how many in all, and the correct ones.
struct Found {
  std::size_t matches = 0;
  std::vector<Correct> correct;
};

class Judge {
 public:
  Judge(const Renderer& renderer, std::size_t first, std::size_t second)
      : renderer_(renderer), first_(first), second_(second) {
    const auto& poses = renderer.scene().cam_from_world;
    essential_ = EssentialFromPose(poses[second] * poses[first].Inverse());
  }

  /// The match's errors; none when it is wrong.
  std::optional<Correct> operator()(const Keypoint& a, const Keypoint& b) const {
    const CameraModel& model = renderer_.scene().camera.model;
    const auto ideal_a = model.Normalize(a.Position()), ideal_b = model.Normalize(b.Position());
    if (!ideal_a || !ideal_b) return std::nullopt;
    const Eigen::Vector3d x = ideal_a->homogeneous(), y = ideal_b->homogeneous();
    const Eigen::Vector3d line_b = essential_ * x, line_a = essential_.transpose() * y;
    const double product = std::abs(y.dot(line_b)) * model.MeanFocal();
    Correct result{.first_image = first_,
                   .second_image = second_,
                   .first_px = a.Position(),
                   .second_px = b.Position(),
                   .scale_px = a.scale_px,
                   .response = std::min(a.response, b.response),
                   .first_error_px = product / line_a.head<2>().norm(),
                   .second_error_px = product / line_b.head<2>().norm()};
    if (std::max(result.first_error_px, result.second_error_px) > kEpipolarGate_px) return std::nullopt;
    const auto point = renderer_.SurfacePoint(first_, result.first_px);
    if (!point) return std::nullopt;
    const auto there = renderer_.Project(second_, *point);
    if (!there) return std::nullopt;
    result.surface_error_px = (*there - result.second_px).norm();
    return result.surface_error_px <= kSurfaceGate_px ? std::optional(result) : std::nullopt;
  }

 private:
  const Renderer& renderer_;
  std::size_t first_, second_;
  Eigen::Matrix3d essential_;
};

void AddMatches(const Renderer& renderer, std::size_t first, std::size_t second, const ImageFeatures& a,
                const ImageFeatures& b, Found& found) {
  SerialRunContext context;
  const Judge judge(renderer, first, second);
  for (const Match& m : matching::Run(a.descriptors, b.descriptors, {.ratio = 0.8, .mutual = true}, context)) {
    ++found.matches;
    const auto correct = judge(a.keypoints[m.first], b.keypoints[m.second]);
    if (correct) found.correct.push_back(*correct);
  }
}

/// Root mean square of the distances to the epipolar lines, of both images.
double EpipolarRms(const std::vector<Correct>& matches) {
  double sum = 0;
  for (const Correct& m : matches) {
    sum += 0.5 * (m.first_error_px * m.first_error_px + m.second_error_px * m.second_error_px);
  }
  return matches.empty() ? 0 : std::sqrt(sum / static_cast<double>(matches.size()));
}

double SurfaceRms(const std::vector<Correct>& matches) {
  double sum = 0;
  for (const Correct& m : matches) sum += m.surface_error_px * m.surface_error_px;
  return matches.empty() ? 0 : std::sqrt(sum / static_cast<double>(matches.size()));
}

double MedianError(const std::vector<Correct>& matches) {
  if (matches.empty()) return 0;
  std::vector<double> errors;
  for (const Correct& m : matches) errors.push_back(m.second_error_px);
  std::nth_element(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2), errors.end());
  return errors[errors.size() / 2];
}

Json Summary(const std::vector<Correct>& matches) {
  Json by_scale = Json::array();
  for (const auto& [from, to] : {std::pair{0.0, 1.6}, {1.6, 2.5}, {2.5, 4.0}, {4.0, 8.0}, {8.0, 1e9}}) {
    std::vector<Correct> part;
    std::copy_if(matches.begin(), matches.end(), std::back_inserter(part),
                 [&, low = from, high = to](const Correct& m) { return m.scale_px >= low && m.scale_px < high; });
    by_scale.push_back({{"from_px", from}, {"matches", part.size()}, {"epipolar_rms_px", EpipolarRms(part)}});
  }
  return {{"matches", matches.size()},
          {"epipolar_rms_px", EpipolarRms(matches)},
          {"epipolar_median_px", MedianError(matches)},
          {"surface_rms_px", SurfaceRms(matches)},
          {"by_scale", by_scale}};
}

std::vector<Correct> StrongestMatches(std::vector<Correct> matches, std::size_t count) {
  std::stable_sort(matches.begin(), matches.end(),
                   [](const Correct& a, const Correct& b) { return a.response > b.response; });
  matches.resize(std::min(count, matches.size()));
  return matches;
}

/// The matches of `a` that `b` has as well: within 1 px in both images, scales within a fifth.
std::vector<Correct> AlsoIn(const std::vector<Correct>& a, const std::vector<Correct>& b) {
  std::vector<std::size_t> order(b.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](auto i, auto j) { return b[i].first_px.x() < b[j].first_px.x(); });
  const auto same = [](const Correct& m, const Correct& n) {
    return m.first_image == n.first_image && m.second_image == n.second_image &&
           (m.first_px - n.first_px).norm() <= 1 && (m.second_px - n.second_px).norm() <= 1 &&
           std::abs(std::log(m.scale_px / n.scale_px)) <= 0.2;
  };
  std::vector<Correct> result;
  for (const Correct& m : a) {
    auto it = std::lower_bound(order.begin(), order.end(), m.first_px.x() - 1,
                               [&](std::size_t i, double x) { return b[i].first_px.x() < x; });
    for (; it != order.end() && b[*it].first_px.x() <= m.first_px.x() + 1; ++it) {
      if (!same(m, b[*it])) continue;
      result.push_back(m);
      break;
    }
  }
  return result;
}

Json Compare(const Found& ours, const Found& peer) {
  const std::size_t fewer = std::min(ours.correct.size(), peer.correct.size());
  const auto both = [](const std::vector<Correct>& a, const std::vector<Correct>& b) {
    return Json{{"ours", Summary(a)}, {"opencv", Summary(b)}};
  };
  return {{"all_matches", {{"ours", ours.matches}, {"opencv", peer.matches}}},
          {"correct", both(ours.correct, peer.correct)},
          {"equal_number", both(StrongestMatches(ours.correct, fewer), StrongestMatches(peer.correct, fewer))},
          {"in_both", both(AlsoIn(ours.correct, peer.correct), AlsoIn(peer.correct, ours.correct))}};
}

void Append(Found& all, const Found& part) {
  all.matches += part.matches;
  all.correct.insert(all.correct.end(), part.correct.begin(), part.correct.end());
}

struct BothFound {
  Found ours, peer;
};

/// Neighbours and second neighbours of a block; equal numbers of features in each image.
BothFound RunBlock(const simulation::SceneOptions& options, std::size_t first_index, Json& features) {
  const Renderer renderer(simulation::MakeScene(options));
  SerialRunContext context;
  const features::Options choice = AllFeatures();
  std::vector<ImageFeatures> ours, peer;
  const auto images = static_cast<std::size_t>(options.images);
  for (std::size_t i = 0; i < images; ++i) {
    const GreyImage image = renderer.RenderGrey(i);
    ImageFeatures a = DetectOurs(image, choice, context);
    ImageFeatures b =
        DetectPeer(image, {.contrast_threshold = choice.contrast_threshold, .edge_threshold = choice.edge_threshold});
    const std::size_t fewer = std::min(a.keypoints.size(), b.keypoints.size());
    features.push_back({{"ours", a.keypoints.size()}, {"opencv", b.keypoints.size()}, {"used", fewer}});
    ours.push_back(Strongest(a, fewer));
    peer.push_back(Strongest(b, fewer));
    peer.back().descriptors = RootSift(peer.back().descriptors);  // as ours: only positions are compared here
  }
  BothFound found;
  for (std::size_t step = 1; step <= 2; ++step) {
    for (std::size_t i = 0; i + step < images; ++i) {
      AddMatches(renderer, i, i + step, ours[i], ours[i + step], found.ours);
      AddMatches(renderer, i, i + step, peer[i], peer[i + step], found.peer);
    }
  }
  for (Found* f : {&found.ours, &found.peer}) {
    for (Correct& m : f->correct) {
      m.first_image += first_index;
      m.second_image += first_index;
    }
  }
  return found;
}

}  // namespace

Json MeasureLocalisation() {
  simulation::SceneOptions relief;
  relief.images = 4;
  relief.width_px = 2400;
  relief.height_px = 1800;
  relief.angle_step_deg = 8;
  simulation::SceneOptions statue = relief;
  statue.surface = "statue";
  statue.seed = 2;
  Json result;
  BothFound all;
  std::size_t images = 0;
  for (const auto* options : {&relief, &statue}) {
    Json features = Json::array();
    const BothFound found = RunBlock(*options, images, features);
    images += static_cast<std::size_t>(options->images);
    result[options->surface] = Compare(found.ours, found.peer);
    result[options->surface]["features"] = features;
    Append(all.ours, found.ours);
    Append(all.peer, found.peer);
  }
  result["all"] = Compare(all.ours, all.peer);
  return result;
}

}  // namespace rilievo::bench
