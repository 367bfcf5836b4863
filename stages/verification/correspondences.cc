// Undistorts, merges and shuffles the matches of a pair.
#include "stages/verification/correspondences.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

namespace rilievo::verification {
namespace {

std::optional<Eigen::Vector2d> Ideal(const Camera& camera, const Keypoint& keypoint) {
  if (!std::isfinite(keypoint.x_px) || !std::isfinite(keypoint.y_px)) return std::nullopt;
  const auto ideal = camera.model.Normalize(keypoint.Position());
  if (!ideal || !ideal->allFinite()) return std::nullopt;
  return ideal;
}

double Variance(const Camera& camera) {
  const double focal = camera.model.MeanFocal();
  return 1 / (focal * focal);
}

}  // namespace

Correspondences MakeCorrespondences(const Input& input, std::uint64_t seed) {
  // Matches of one position pair become neighbours.
  struct Entry {
    std::array<float, 4> position;
    std::uint32_t match;
    auto operator<=>(const Entry&) const = default;
  };
  std::vector<Entry> entries;
  entries.reserve(input.matches.size());
  for (std::uint32_t i = 0; i < input.matches.size(); ++i) {
    const Match& match = input.matches[i];
    if (match.first >= input.keypoints_first.size() || match.second >= input.keypoints_second.size()) continue;
    const Keypoint &a = input.keypoints_first[match.first], &b = input.keypoints_second[match.second];
    if (std::isnan(a.x_px + a.y_px + b.x_px + b.y_px)) continue;  // NaN has no place in an order
    entries.push_back({{a.x_px, a.y_px, b.x_px, b.y_px}, i});
  }
  std::sort(entries.begin(), entries.end());

  std::vector<Eigen::Vector2d> first, second;
  std::vector<std::vector<std::uint32_t>> matches;
  for (std::size_t begin = 0, end = 0; begin < entries.size(); begin = end) {
    while (end < entries.size() && entries[end].position == entries[begin].position) ++end;
    const Match& match = input.matches[entries[begin].match];
    const auto x = Ideal(input.camera_first, input.keypoints_first[match.first]);
    const auto y = Ideal(input.camera_second, input.keypoints_second[match.second]);
    if (!x || !y) continue;
    first.push_back(*x);
    second.push_back(*y);
    auto& group = matches.emplace_back();
    for (std::size_t i = begin; i < end; ++i) group.push_back(entries[i].match);
  }

  const std::vector<std::uint32_t> order = ShuffledOrder(first.size(), seed);
  const PointPairs sorted(std::move(first), std::move(second),
                          {Variance(input.camera_first), Variance(input.camera_second)});
  Correspondences result{sorted.Subset(order), {}};
  for (const auto i : order) result.matches.push_back(std::move(matches[i]));
  return result;
}

}  // namespace rilievo::verification
