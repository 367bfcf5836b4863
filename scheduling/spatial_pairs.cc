// Geodetic positions to metres, and nearest neighbours by a sweep along one axis.
#include "scheduling/spatial_pairs.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <queue>

#include "base/units.h"

namespace rilievo::scheduling {
namespace {

/// WGS84: semi-major axis and first eccentricity squared (NIMA TR8350.2, table 3.1 and 3.3).
constexpr double kSemiMajor_m = 6378137.0, kEccentricity_sq = 6.69437999014e-3;

/// Geodetic to earth-centred coordinates (Heiskanen & Moritz, Physical Geodesy, eq. 5-3).
Eigen::Vector3d EarthCentred(double latitude_rad, double longitude_rad, double height_m) {
  const double sine = std::sin(latitude_rad), cosine = std::cos(latitude_rad);
  const double normal_m = kSemiMajor_m / std::sqrt(1 - kEccentricity_sq * sine * sine);
  return {(normal_m + height_m) * cosine * std::cos(longitude_rad),
          (normal_m + height_m) * cosine * std::sin(longitude_rad),
          (normal_m * (1 - kEccentricity_sq) + height_m) * sine};
}

struct Place {
  std::uint32_t image = 0;
  Eigen::Vector3d at_m;
};

/// Places in ascending order along the axis of their largest extent.
std::vector<Place> Sorted(std::span<const std::optional<Eigen::Vector3d>> positions, int& axis) {
  std::vector<Place> places;
  constexpr double kFar = std::numeric_limits<double>::infinity();
  Eigen::Vector3d low = Eigen::Vector3d::Constant(kFar), high = -low;
  for (std::uint32_t i = 0; i < positions.size(); ++i) {
    if (!positions[i]) continue;
    places.push_back({i, *positions[i]});
    low = low.cwiseMin(*positions[i]);
    high = high.cwiseMax(*positions[i]);
  }
  if (!places.empty()) (high - low).maxCoeff(&axis);
  std::sort(places.begin(), places.end(), [axis](const Place& a, const Place& b) {
    return a.at_m[axis] != b.at_m[axis] ? a.at_m[axis] < b.at_m[axis] : a.image < b.image;
  });
  return places;
}

/// The squared distance of the k-th nearest other place, and the limit where that is nearer.
class Reach {
 public:
  explicit Reach(const SpatialRule& rule)
      : k_(rule.neighbours > 0 ? static_cast<std::size_t>(rule.neighbours) : std::numeric_limits<std::size_t>::max()),
        limit_sq_m2_(rule.max_distance_m > 0 ? rule.max_distance_m * rule.max_distance_m
                                             : std::numeric_limits<double>::infinity()) {}
  double SquaredReach() const { return nearest_.size() < k_ ? limit_sq_m2_ : std::min(limit_sq_m2_, nearest_.top()); }
  void Offer(double distance_sq_m2) {
    if (k_ == std::numeric_limits<std::size_t>::max()) return;
    nearest_.push(distance_sq_m2);
    if (nearest_.size() > k_) nearest_.pop();
  }

 private:
  std::size_t k_;
  double limit_sq_m2_;
  std::priority_queue<double> nearest_;  ///< the k least
};

/// Calls fn(other, squared distance) for the places from `at` outwards to both sides, nearest along the axis first,
/// until neither side has one within reach() along it.
template <class Fn, class ReachFn>
void Outwards(const std::vector<Place>& places, std::size_t at, int axis, ReachFn&& reach, Fn&& fn) {
  const Eigen::Vector3d& from = places[at].at_m;
  const auto gap_sq = [&](std::size_t other) { return std::pow(places[other].at_m[axis] - from[axis], 2); };
  std::size_t left = at, right = at + 1;  // next: left - 1 and right
  while (true) {
    const double left_sq = left > 0 ? gap_sq(left - 1) : std::numeric_limits<double>::infinity();
    const double right_sq = right < places.size() ? gap_sq(right) : std::numeric_limits<double>::infinity();
    if ((left == 0 && right == places.size()) || std::min(left_sq, right_sq) > reach()) return;
    const std::size_t other = left_sq <= right_sq ? --left : right++;
    fn(places[other].image, (places[other].at_m - from).squaredNorm());
  }
}

}  // namespace

std::vector<std::optional<Eigen::Vector3d>> ImagePositions(const Block& block) {
  const bool heights_count = std::all_of(block.images.begin(), block.images.end(), [](const Image& image) {
    return !image.exif.gnss || (*image.exif.gnss)[2] != 0;
  });
  std::vector<std::optional<Eigen::Vector3d>> positions;
  for (const Image& image : block.images) {
    positions.emplace_back();
    if (const auto& gnss = image.exif.gnss)
      positions.back() = EarthCentred(DegToRad((*gnss)[0]), DegToRad((*gnss)[1]), heights_count ? (*gnss)[2] : 0);
  }
  return positions;
}

std::vector<ImagePair> SpatialPairs(std::span<const std::optional<Eigen::Vector3d>> positions,
                                    const SpatialRule& rule) {
  std::vector<ImagePair> pairs;
  const auto add = [&](std::uint32_t a, std::uint32_t b) {
    pairs.push_back({ImageId(std::min(a, b)), ImageId(std::max(a, b))});
  };
  for (std::uint32_t i = 0; i < positions.size(); ++i)
    for (std::uint32_t j = 0; j < positions.size() && !positions[i]; ++j)
      if (j != i) add(i, j);
  int axis = 0;
  const std::vector<Place> places = Sorted(positions, axis);
  for (std::size_t at = 0; at < places.size(); ++at) {
    Reach nearest(rule);
    Outwards(
        places, at, axis, [&] { return nearest.SquaredReach(); },
        [&](std::uint32_t, double distance_sq_m2) { nearest.Offer(distance_sq_m2); });
    const double reach_sq_m2 = nearest.SquaredReach();
    Outwards(
        places, at, axis, [&] { return reach_sq_m2; },
        [&](std::uint32_t other, double distance_sq_m2) {
          if (distance_sq_m2 <= reach_sq_m2) add(places[at].image, other);
        });
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  return pairs;
}

}  // namespace rilievo::scheduling
