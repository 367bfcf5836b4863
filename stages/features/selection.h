// Which of an image's features are kept, and in which order.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "stages/features/feature.h"

namespace rilievo::features {

/// The strongest `max_features`. With `spread` those come first that are among the strongest of their cell of a square
/// grid over the image, in twice as many as each cell's share; the strongest of the others fill what is left.
struct SelectionRule {
  std::size_t max_features = 0;
  bool spread = false;
  int width_px = 0, height_px = 0;
};

/// Applies the rule. Sorted by (y, x, scale, angle) without repetitions (equal in all of these); ties in strength go by
/// that order. The order of `features` does not matter.
std::vector<Feature> SelectFeatures(std::vector<Feature> features, const SelectionRule& rule);

/// Drops what the rule cannot choose, whatever features of the same image are added: SelectFeatures gives the same
/// before and after. Bounds what is held while an image is worked on.
std::vector<Feature> PruneFeatures(std::vector<Feature> features, const SelectionRule& rule);

/// Upper bound of the features that PruneFeatures leaves.
std::size_t MostAfterPruning(const SelectionRule& rule);

/// Gathers features, never more than a quarter (and some thousand) above what pruning leaves.
class FeatureCollector {
 public:
  explicit FeatureCollector(const SelectionRule& rule) : rule_(rule) {}
  void Add(const Feature& feature);
  void Add(std::vector<Feature> features);
  std::vector<Feature> Take() { return std::move(features_); }
  /// Upper bound of the bytes that one holds, while it prunes too.
  static std::size_t MostBytes(const SelectionRule& rule);

 private:
  void PruneIfFull();
  SelectionRule rule_;
  std::vector<Feature> features_;
  std::size_t full_ = kLeastFull;
  static constexpr std::size_t kLeastFull = 4096;
};

}  // namespace rilievo::features
