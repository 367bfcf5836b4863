// Undistorts, merges and shuffles the matches of a pair.
#include "stages/verification/correspondences.h"

#include <algorithm>
#include <bit>
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

/// Both positions of a match as integers that are equal when they are, which sort faster than floats.
struct Entry {
  std::uint64_t first = 0, second = 0;
  std::uint32_t match = 0;
  auto operator<=>(const Entry&) const = default;
  bool SamePlace(const Entry& other) const { return first == other.first && second == other.second; }
};

std::uint64_t Bits(const Keypoint& keypoint) {
  const auto bits = [](float v) { return std::uint64_t{std::bit_cast<std::uint32_t>(v + 0.0F)}; };  // -0 is 0
  return bits(keypoint.x_px) << 32 | bits(keypoint.y_px);
}

/// Sorted, so that matches of one place are neighbours.
std::vector<Entry> SortedEntries(const Input& input) {
  std::vector<Entry> entries;
  entries.reserve(input.matches.size());
  for (std::uint32_t i = 0; i < input.matches.size(); ++i) {
    const Match& match = input.matches[i];
    if (match.first >= input.keypoints_first.size() || match.second >= input.keypoints_second.size()) continue;
    entries.push_back({Bits(input.keypoints_first[match.first]), Bits(input.keypoints_second[match.second]), i});
  }
  std::sort(entries.begin(), entries.end());
  return entries;
}

}  // namespace

Correspondences MakeCorrespondences(const Input& input, std::uint64_t seed) {
  struct Place {
    Eigen::Vector2d first, second;
    std::size_t begin, end;  // of its entries
  };
  const std::vector<Entry> entries = SortedEntries(input);
  std::vector<Place> places;
  places.reserve(entries.size());
  for (std::size_t begin = 0, end = 0; begin < entries.size(); begin = end) {
    while (end < entries.size() && entries[end].SamePlace(entries[begin])) ++end;
    const Match& match = input.matches[entries[begin].match];
    const auto x = Ideal(input.camera_first, input.keypoints_first[match.first]);
    const auto y = Ideal(input.camera_second, input.keypoints_second[match.second]);
    if (x && y) places.push_back({*x, *y, begin, end});
  }
  std::vector<Eigen::Vector2d> first, second;
  std::vector<std::uint32_t> matches, begins{0};
  first.reserve(places.size());
  second.reserve(places.size());
  matches.reserve(entries.size());
  begins.reserve(places.size() + 1);
  for (const auto i : ShuffledOrder(places.size(), seed)) {
    const Place& place = places[i];
    first.push_back(place.first);
    second.push_back(place.second);
    for (std::size_t k = place.begin; k < place.end; ++k) matches.push_back(entries[k].match);
    begins.push_back(static_cast<std::uint32_t>(matches.size()));
  }
  return {
      PointPairs(std::move(first), std::move(second), {Variance(input.camera_first), Variance(input.camera_second)}),
      std::move(matches), std::move(begins)};
}

}  // namespace rilievo::verification
