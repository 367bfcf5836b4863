// Which of an image's features are kept, and in which order.
#include "stages/features/selection.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <numeric>
#include <tuple>

namespace rilievo::features {
namespace {

constexpr double kFeaturesPerCell = 16;

auto PositionOrder(const Keypoint& k) { return std::tie(k.y_px, k.x_px, k.scale_px, k.angle_rad); }

/// Rank of every feature among those of its cell: 0 for the strongest. `by_strength` lists features strongest first.
std::vector<std::uint32_t> RanksInCells(const std::vector<Feature>& features,
                                        const std::vector<std::uint32_t>& by_strength, std::size_t max_features,
                                        int width_px, int height_px) {
  const double side_px =
      std::sqrt(static_cast<double>(width_px) * height_px * kFeaturesPerCell / static_cast<double>(max_features));
  const int columns = 1 + static_cast<int>(width_px / side_px);
  std::map<int, std::uint32_t> counts;
  std::vector<std::uint32_t> ranks(features.size());
  for (const std::uint32_t i : by_strength) {
    const Keypoint& k = features[i].keypoint;
    const int cell = static_cast<int>(k.y_px / side_px) * columns + static_cast<int>(k.x_px / side_px);
    ranks[i] = counts[cell]++;
  }
  return ranks;
}

}  // namespace

std::vector<Feature> SelectFeatures(std::vector<Feature> features, std::size_t max_features, bool spread, int width_px,
                                    int height_px) {
  std::sort(features.begin(), features.end(), [](const Feature& a, const Feature& b) {
    const Keypoint &p = a.keypoint, &q = b.keypoint;
    return PositionOrder(p) != PositionOrder(q) ? PositionOrder(p) < PositionOrder(q) : p.response > q.response;
  });
  features.erase(std::unique(features.begin(), features.end(),
                             [](const Feature& a, const Feature& b) {
                               return PositionOrder(a.keypoint) == PositionOrder(b.keypoint);
                             }),
                 features.end());
  if (features.size() <= max_features) return features;

  std::vector<std::uint32_t> order(features.size());
  std::iota(order.begin(), order.end(), 0U);
  std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return features[a].keypoint.response > features[b].keypoint.response;
  });
  if (spread) {
    const auto ranks = RanksInCells(features, order, max_features, width_px, height_px);
    std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) { return ranks[a] < ranks[b]; });
  }
  order.resize(max_features);
  std::sort(order.begin(), order.end());
  std::vector<Feature> kept;
  kept.reserve(max_features);
  for (const std::uint32_t i : order) kept.push_back(features[i]);
  return kept;
}

}  // namespace rilievo::features
