// Which of an image's features are kept, and in which order.
#include "stages/features/selection.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <numeric>
#include <tuple>

namespace rilievo::features {
namespace {

/// Features a cell of the grid has on average when an image gives as many as are kept, and how many of each cell go
/// before all others.
constexpr double kFeaturesPerCell = 16;
constexpr std::uint32_t kFirstOfCell = 32;

auto PositionOrder(const Keypoint& k) { return std::tie(k.y_px, k.x_px, k.scale_px, k.angle_rad); }

void SortAndDropRepetitions(std::vector<Feature>& features) {
  std::sort(features.begin(), features.end(), [](const Feature& a, const Feature& b) {
    const Keypoint &p = a.keypoint, &q = b.keypoint;
    return PositionOrder(p) != PositionOrder(q) ? PositionOrder(p) < PositionOrder(q) : p.response > q.response;
  });
  const auto is_repeated = [](const Feature& a, const Feature& b) {
    return PositionOrder(a.keypoint) == PositionOrder(b.keypoint);
  };
  features.erase(std::unique(features.begin(), features.end(), is_repeated), features.end());
}

struct Grid {
  explicit Grid(const SelectionRule& rule)
      : side_px(std::sqrt(static_cast<double>(rule.width_px) * rule.height_px * kFeaturesPerCell /
                          static_cast<double>(rule.max_features))),
        columns(1 + static_cast<std::size_t>(rule.width_px / side_px)),
        rows(1 + static_cast<std::size_t>(rule.height_px / side_px)) {}
  std::size_t CellOf(const Keypoint& k) const {
    const auto index = [&](float position_px, std::size_t count) {
      return std::min(static_cast<std::size_t>(std::max(0.0F, position_px) / side_px), count - 1);
    };
    return index(k.y_px, rows) * columns + index(k.x_px, columns);
  }
  double side_px;
  std::size_t columns, rows;
};

/// Indices of sorted features, the strongest first.
std::vector<std::uint32_t> ByStrength(const std::vector<Feature>& features) {
  std::vector<std::uint32_t> order(features.size());
  std::iota(order.begin(), order.end(), 0U);
  std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return features[a].keypoint.response > features[b].keypoint.response;
  });
  return order;
}

/// Moves the first features of every cell to the front of an order by strength; returns their number.
std::size_t FirstOfCellsToFront(const std::vector<Feature>& features, const SelectionRule& rule,
                                std::vector<std::uint32_t>& order) {
  const Grid grid(rule);
  std::vector<std::uint32_t> counts(grid.columns * grid.rows);
  const auto others = std::stable_partition(order.begin(), order.end(), [&](std::uint32_t i) {
    return counts[grid.CellOf(features[i].keypoint)]++ < kFirstOfCell;
  });
  return static_cast<std::size_t>(others - order.begin());
}

/// The chosen ones in the order they have, in place.
std::vector<Feature> Keep(std::vector<Feature> features, std::vector<std::uint32_t> chosen) {
  std::sort(chosen.begin(), chosen.end());
  for (std::size_t i = 0; i < chosen.size(); ++i) features[i] = features[chosen[i]];  // chosen[i] >= i
  features.resize(chosen.size());
  return features;
}

}  // namespace

std::vector<Feature> SelectFeatures(std::vector<Feature> features, const SelectionRule& rule) {
  SortAndDropRepetitions(features);
  if (features.size() <= rule.max_features) return features;
  std::vector<std::uint32_t> order = ByStrength(features);
  if (rule.spread) FirstOfCellsToFront(features, rule, order);
  order.resize(rule.max_features);
  return Keep(std::move(features), std::move(order));
}

std::vector<Feature> PruneFeatures(std::vector<Feature> features, const SelectionRule& rule) {
  SortAndDropRepetitions(features);
  if (features.size() <= rule.max_features) return features;
  std::vector<std::uint32_t> order = ByStrength(features),
                             chosen(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(rule.max_features));
  if (rule.spread) {
    order.resize(FirstOfCellsToFront(features, rule, order));
    std::vector<std::uint32_t> both;
    std::sort(order.begin(), order.end());
    std::sort(chosen.begin(), chosen.end());
    std::set_union(order.begin(), order.end(), chosen.begin(), chosen.end(), std::back_inserter(both));
    chosen = std::move(both);
  }
  return Keep(std::move(features), std::move(chosen));
}

std::size_t MostAfterPruning(const SelectionRule& rule) {
  if (!rule.spread) return rule.max_features;
  const Grid grid(rule);
  return rule.max_features + kFirstOfCell * grid.columns * grid.rows;
}

void FeatureCollector::Add(const Feature& feature) {
  PruneIfFull();
  features_.push_back(feature);
}

void FeatureCollector::Add(std::vector<Feature> features) {
  if (features_.empty()) {
    features_ = std::move(features);
  } else {
    for (const Feature& feature : features) Add(feature);
  }
}

void FeatureCollector::PruneIfFull() {
  if (features_.size() < full_) return;
  features_ = PruneFeatures(std::move(features_), rule_);
  full_ = std::max(kLeastFull, features_.size() + features_.size() / 4);
  features_.reserve(full_);
}

std::size_t FeatureCollector::MostBytes(const SelectionRule& rule) {
  const std::size_t most = MostAfterPruning(rule) + MostAfterPruning(rule) / 4 + kLeastFull;
  return most * (sizeof(Feature) + 2 * sizeof(std::uint32_t));
}

}  // namespace rilievo::features
