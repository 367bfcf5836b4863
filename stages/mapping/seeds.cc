// Ranking of the start pairs.
#include "stages/mapping/seeds.h"

#include <algorithm>
#include <array>
#include <tuple>

#include "base/units.h"

namespace rilievo::mapping {
namespace {

constexpr std::array<double, 4> kLeastAngles_deg{5.0, 3.0, 1.5, 0.5};

}  // namespace

std::vector<SeedPair> SeedPairs(std::span<const TwoViewGeometry> pairs) {
  std::vector<SeedPair> seeds;
  for (const TwoViewGeometry& g : pairs) {
    const bool general = g.model == TwoViewModel::kEssential, planar = g.model == TwoViewModel::kHomography;
    if ((!general && !planar) || g.second_from_first.translation.norm() < 0.5) continue;
    const double angle_deg = RadToDeg(g.median_angle_rad);
    const auto step = std::find_if(kLeastAngles_deg.begin(), kLeastAngles_deg.end(), [&](double least) { return angle_deg >= least; });
    if (step == kLeastAngles_deg.end()) continue;
    SeedPair seed{g.pair, g.second_from_first, static_cast<double>(g.inliers.size()) * std::min(1.0, angle_deg / 15.0), 0};
    seed.tier = static_cast<int>(step - kLeastAngles_deg.begin()) + (planar ? static_cast<int>(kLeastAngles_deg.size()) : 0);
    seeds.push_back(seed);
  }
  std::sort(seeds.begin(), seeds.end(), [](const SeedPair& a, const SeedPair& b) {
    return std::tuple(a.tier, -a.score, a.pair) < std::tuple(b.tier, -b.score, b.pair);
  });
  return seeds;
}

}  // namespace rilievo::mapping
