// Corresponding regions of two images of a plane: overlap of ellipses (Mikolajczyk et al., IJCV 65, 2005, section 4).
#include "bench/accuracy/features_overlap.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>

namespace rilievo::bench {
namespace {

/// Origin at the first pixel's centre, as homographies have it.
Eigen::Vector2d InHomographyFrame(const Keypoint& k) { return k.Position() - Eigen::Vector2d(0.5, 0.5); }

/// Image of a point, none at or behind the horizon.
struct Mapped {
  bool is_finite = false;
  Eigen::Vector2d point = Eigen::Vector2d::Zero();
  Eigen::Matrix2d affine = Eigen::Matrix2d::Zero();  ///< d point / d source
};

Mapped MapPoint(const Eigen::Matrix3d& h, const Eigen::Vector2d& source) {
  const Eigen::Vector3d x = h * source.homogeneous();
  if (x.z() <= 0) return {};
  Mapped result{.is_finite = true, .point = x.hnormalized(), .affine = {}};
  result.affine = (h.topLeftCorner<2, 2>() - result.point * h.block<1, 2>(2, 0)) / x.z();
  return result;
}

/// Scaled so that the image's middle has z > 0.
Eigen::Matrix3d Oriented(const Eigen::Matrix3d& h, const ImageSize& size) {
  const Eigen::Vector2d middle(0.5 * size.width_px, 0.5 * size.height_px);
  return (h * middle.homogeneous()).z() < 0 ? Eigen::Matrix3d(-h) : h;
}

bool Inside(const Eigen::Vector2d& p, const ImageSize& size) {
  return p.x() >= -0.5 && p.y() >= -0.5 && p.x() <= size.width_px - 0.5 && p.y() <= size.height_px - 0.5;
}

/// Length of y in both convex regions on the line x.
double CommonLength(double x, double radius_sq, const Eigen::Vector2d& center, const Eigen::Matrix2d& inverse) {
  const double half_sq = radius_sq - x * x;
  const double dx = x - center.x(), a = inverse(1, 1), b = inverse(0, 1) * dx, c = inverse(0, 0) * dx * dx - 1;
  const double root_sq = b * b - a * c;
  if (half_sq <= 0 || root_sq <= 0) return 0;
  const double half = std::sqrt(half_sq), root = std::sqrt(root_sq);
  return std::max(0.0, std::min(half, center.y() + (root - b) / a) - std::max(-half, center.y() - (root + b) / a));
}

/// Points in buckets, to find those within a radius of one cell.
class Buckets {
 public:
  Buckets(const ImageSize& size, double cell) : cell_(cell), columns_(Cell(size.width_px) + 3) {
    lists_.resize(columns_ * (Cell(size.height_px) + 3));
  }
  void Add(const Eigen::Vector2d& p, std::uint32_t index) { lists_[Index(p, 0, 0)].push_back(index); }
  template <class F>
  void Near(const Eigen::Vector2d& p, F&& f) const {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        for (const std::uint32_t i : lists_[Index(p, dx, dy)]) f(i);
      }
    }
  }

 private:
  std::size_t Cell(double v) const { return static_cast<std::size_t>(std::max(0.0, v + 0.5) / cell_); }
  std::size_t Index(const Eigen::Vector2d& p, int dx, int dy) const {
    const auto column = static_cast<std::ptrdiff_t>(Cell(p.x())) + 1 + dx;
    const auto row = static_cast<std::ptrdiff_t>(Cell(p.y())) + 1 + dy;
    return static_cast<std::size_t>(row) * columns_ + static_cast<std::size_t>(column);
  }
  double cell_;
  std::size_t columns_;
  std::vector<std::vector<std::uint32_t>> lists_;
};

}  // namespace

double OverlapError(double radius, const Eigen::Vector2d& center, const Eigen::Matrix2d& shape) {
  const double area = std::numbers::pi * std::sqrt(shape.determinant()), own = std::numbers::pi * radius * radius;
  const double reach = std::sqrt(shape(0, 0));
  const double from = std::max(-radius, center.x() - reach), to = std::min(radius, center.x() + reach);
  if (from >= to) return 1;
  constexpr int kLines = 200;
  const Eigen::Matrix2d inverse = shape.inverse();
  const double step = (to - from) / kLines;
  double common = 0;
  for (int i = 0; i < kLines; ++i) common += CommonLength(from + (i + 0.5) * step, radius * radius, center, inverse);
  common *= step;
  return 1 - common / (area + own - common);
}

CommonPart FindCommonPart(const PlanarPair& pair) {
  CommonPart result{.first = std::vector<bool>(pair.first.size()), .second = std::vector<bool>(pair.second.size())};
  const Eigen::Matrix3d forth = Oriented(pair.second_from_first, pair.first_size);
  const Eigen::Matrix3d back = Oriented(pair.second_from_first.inverse(), pair.second_size);
  for (std::size_t i = 0; i < pair.first.size(); ++i) {
    const Mapped m = MapPoint(forth, InHomographyFrame(pair.first[i]));
    result.first[i] = m.is_finite && Inside(m.point, pair.second_size);
    result.first_count += result.first[i];
  }
  for (std::size_t i = 0; i < pair.second.size(); ++i) {
    const Mapped m = MapPoint(back, InHomographyFrame(pair.second[i]));
    result.second[i] = m.is_finite && Inside(m.point, pair.first_size);
    result.second_count += result.second[i];
  }
  return result;
}

std::vector<RegionPair> OverlappingRegions(const PlanarPair& pair, const CommonPart& common, const OverlapRule& rule) {
  const Eigen::Matrix3d back = Oriented(pair.second_from_first.inverse(), pair.second_size);
  const auto radius_of = [&](const Keypoint& k) { return rule.radius_sigmas * static_cast<double>(k.scale_px); };
  // Where the ellipse's centre is outside of the circle, less than half of the ellipse is inside: with areas in a ratio
  // of 0.6 to 1/0.6 the error is then above 0.5. So a search within the circle's radius misses nothing.
  double cell = rule.normal_radius_px;
  if (cell <= 0) {
    for (const Keypoint& k : pair.first) cell = std::max(cell, radius_of(k));
  }
  Buckets buckets(pair.first_size, std::max(cell, 1.0));
  std::vector<Mapped> mapped(pair.second.size());
  for (std::uint32_t j = 0; j < pair.second.size(); ++j) {
    if (!common.second[j]) continue;
    mapped[j] = MapPoint(back, InHomographyFrame(pair.second[j]));
    buckets.Add(mapped[j].point, j);
  }
  std::vector<RegionPair> result;
  for (std::uint32_t i = 0; i < pair.first.size(); ++i) {
    if (!common.first[i]) continue;
    const Eigen::Vector2d origin = InHomographyFrame(pair.first[i]);
    const double own = radius_of(pair.first[i]);
    const double factor = rule.normal_radius_px > 0 ? rule.normal_radius_px / own : 1.0;
    buckets.Near(origin, [&](std::uint32_t j) {
      const Eigen::Vector2d center = mapped[j].point - origin;
      if (center.norm() > factor * own) return;
      const Eigen::Matrix2d& affine = mapped[j].affine;
      const Eigen::Matrix2d form =
          rule.is_similar ? Eigen::Matrix2d(Eigen::Matrix2d::Identity() * std::sqrt(std::abs(affine.determinant())))
                          : affine;
      const Eigen::Matrix2d axes = factor * radius_of(pair.second[j]) * form;
      const double areas = std::abs(axes.determinant()) / (factor * own * factor * own);
      if (std::min(areas, 1 / areas) < 1 - rule.largest_error) return;
      const double error = OverlapError(factor * own, center, axes * axes.transpose());
      if (error <= rule.largest_error) result.push_back({.first = i, .second = j, .error = error});
    });
  }
  std::sort(result.begin(), result.end(), [](const RegionPair& a, const RegionPair& b) {
    return std::tie(a.error, a.first, a.second) < std::tie(b.error, b.first, b.second);
  });
  return result;
}

std::vector<RegionPair> OneToOne(std::span<const RegionPair> by_error, std::size_t first_count,
                                 std::size_t second_count) {
  std::vector<bool> first(first_count), second(second_count);
  std::vector<RegionPair> result;
  for (const RegionPair& p : by_error) {
    if (first[p.first] || second[p.second]) continue;
    first[p.first] = second[p.second] = true;
    result.push_back(p);
  }
  return result;
}

}  // namespace rilievo::bench
