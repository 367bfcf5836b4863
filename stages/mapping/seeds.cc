// Ranking of the start pairs.
#include "stages/mapping/seeds.h"

#include <algorithm>
#include <array>
#include <optional>
#include <tuple>

#include "base/units.h"
#include "geometry/epipolar.h"

namespace rilievo::mapping {
namespace {

constexpr std::array<double, kTiersOfAKind> kLeastAngles_deg{5.0, 3.0, 1.5, 0.5};

struct RelativeOrientation {
  Rigid3 second_from_first;
  double median_angle_rad = 0;
};

/// E = K2^T F K1, then the pose that has most of the inliers in front.
std::optional<RelativeOrientation> FromFundamental(const Input& input, const TwoViewGeometry& g) {
  const CameraModel& camera_first = input.block.camera_of(g.pair.first).model;
  const CameraModel& camera_second = input.block.camera_of(g.pair.second).model;
  const auto matrix = [](const CameraModel& m) {
    Eigen::Matrix3d k;
    k << m.fx, 0, m.cx, 0, m.fy, m.cy, 0, 0, 1;
    return k;
  };
  const Eigen::Matrix3d essential = matrix(camera_second).transpose() * g.matrix * matrix(camera_first);
  std::vector<Eigen::Vector2d> first, second;
  for (const Match& match : g.inliers) {
    const auto p = camera_first.Normalize(input.keypoints[g.pair.first.value][match.first].Position());
    const auto q = camera_second.Normalize(input.keypoints[g.pair.second.value][match.second].Position());
    if (p && q) first.push_back(*p), second.push_back(*q);
  }
  if (first.empty() || !(essential.norm() > 0)) return std::nullopt;
  RelativeOrientation result{SelectPose(essential.normalized(), first, second).second_from_first, 0};
  std::vector<double> angles_rad;
  for (std::size_t i = 0; i < first.size(); ++i) {
    const RayIntersection rays = IntersectRays(result.second_from_first, first[i], second[i]);
    angles_rad.push_back(rays.in_front ? rays.angle_rad : 0);
  }
  const auto middle = angles_rad.begin() + static_cast<std::ptrdiff_t>(angles_rad.size() / 2);
  std::nth_element(angles_rad.begin(), middle, angles_rad.end());
  result.median_angle_rad = *middle;
  return result;
}

std::optional<RelativeOrientation> OrientationOf(const Input& input, const TwoViewGeometry& g) {
  if (g.model == TwoViewModel::kFundamental) return FromFundamental(input, g);
  if (!g.IsVerified()) return std::nullopt;
  return RelativeOrientation{g.second_from_first, g.median_angle_rad};
}

int FirstTier(TwoViewModel model) {
  return kTiersOfAKind * (model == TwoViewModel::kEssential ? 0 : model == TwoViewModel::kHomography ? 1 : 2);
}

}  // namespace

std::vector<SeedPair> SeedPairs(const Input& input, std::span<const TwoViewGeometry> pairs) {
  std::vector<SeedPair> seeds;
  for (const TwoViewGeometry& g : pairs) {
    const auto orientation = OrientationOf(input, g);
    if (!orientation || orientation->second_from_first.translation.norm() < 0.5) continue;
    const double angle_deg = RadToDeg(orientation->median_angle_rad);
    const auto step = std::find_if(kLeastAngles_deg.begin(), kLeastAngles_deg.end(),
                                   [&](double least) { return angle_deg >= least; });
    if (step == kLeastAngles_deg.end()) continue;
    seeds.push_back({g.pair, orientation->second_from_first,
                     static_cast<double>(g.inliers.size()) * std::min(1.0, angle_deg / 15.0),
                     FirstTier(g.model) + static_cast<int>(step - kLeastAngles_deg.begin())});
  }
  std::sort(seeds.begin(), seeds.end(), [](const SeedPair& a, const SeedPair& b) {
    return std::tuple(a.tier, -a.score, a.pair) < std::tuple(b.tier, -b.score, b.pair);
  });
  return seeds;
}

}  // namespace rilievo::mapping
