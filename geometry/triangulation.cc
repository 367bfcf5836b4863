// Linear start, Gauss-Newton steps and the search for agreeing rays.
#include "geometry/triangulation.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "base/rng.h"

namespace rilievo {
namespace {

Eigen::Vector3d Direction(const RayView& view) {
  return view.pose->rotation.transpose() * view.normalized.homogeneous().normalized();
}

double AngleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

struct Support {
  double cost = 0;  ///< sum of min(residual^2, max^2)
  int inliers = 0;
  std::vector<std::uint8_t> is_inlier;
};

Support Score(std::span<const RayView> views, const Eigen::Vector3d& point, double max_residual_px) {
  Support support;
  support.is_inlier.resize(views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    const double r = RayResidualPx(views[i], point);
    const bool inlier = r <= max_residual_px;
    support.is_inlier[i] = inlier;
    support.inliers += inlier;
    support.cost += inlier ? r * r : max_residual_px * max_residual_px;
  }
  return support;
}

std::vector<RayView> Selected(std::span<const RayView> views, const std::vector<std::uint8_t>& mask) {
  std::vector<RayView> kept;
  for (std::size_t i = 0; i < views.size(); ++i)
    if (mask[i]) kept.push_back(views[i]);
  return kept;
}

std::optional<Eigen::Vector3d> Intersect(std::span<const RayView> views) {
  const auto start = IntersectRays(views);
  return start ? RefineIntersection(views, *start) : std::nullopt;
}

/// The point of the best pair; none when no pair intersects.
std::optional<Eigen::Vector3d> BestPairPoint(std::span<const RayView> views, const IntersectionOptions& options) {
  const auto n = static_cast<std::uint32_t>(views.size());
  std::optional<Eigen::Vector3d> best;
  double best_cost = std::numeric_limits<double>::infinity();
  const auto try_pair = [&](std::uint32_t i, std::uint32_t j) {
    const RayView pair[2] = {views[i], views[j]};
    const auto point = IntersectRays(pair);
    if (!point || RayResidualPx(pair[0], *point) > options.max_residual_px ||
        RayResidualPx(pair[1], *point) > options.max_residual_px)
      return;
    if (IntersectionAngle(pair, *point) < options.min_angle_rad) return;
    const double cost = Score(views, *point, options.max_residual_px).cost;
    if (cost < best_cost) best_cost = cost, best = point;
  };
  if (n <= 10) {
    for (std::uint32_t i = 0; i < n; ++i)
      for (std::uint32_t j = i + 1; j < n; ++j) try_pair(i, j);
  } else {
    Rng rng(options.seed);
    for (int k = 0; k < 45; ++k) {
      const std::uint32_t i = rng.Below(n), j = rng.Below(n - 1);
      try_pair(i, j + (j >= i));
    }
  }
  return best;
}

}  // namespace

double RayResidualPx(const RayView& view, const Eigen::Vector3d& point) {
  const Eigen::Vector3d x = view.pose->rotation * point + view.pose->translation;
  if (!(x.z() > 0)) return std::numeric_limits<double>::infinity();
  return (x.head<2>() / x.z() - view.normalized).norm() * view.focal_px;
}

double IntersectionAngle(std::span<const RayView> views, const Eigen::Vector3d& point) {
  const std::size_t stride = std::max<std::size_t>(1, (views.size() + 31) / 32);
  double least_cosine = 1, angle = 0;
  Eigen::Vector3d rays[32];
  std::size_t n = 0;
  for (std::size_t i = 0; i < views.size() && n < 32; i += stride)
    rays[n++] = (point - views[i].pose->center).normalized();
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = i + 1; j < n; ++j) {
      const double cosine = rays[i].dot(rays[j]);
      if (cosine < least_cosine) least_cosine = cosine, angle = AngleBetween(rays[i], rays[j]);
    }
  return angle;
}

std::optional<Eigen::Vector3d> IntersectRays(std::span<const RayView> views) {
  if (views.size() < 2) return std::nullopt;
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  const Eigen::Vector3d origin = views[0].pose->center;
  for (const RayView& view : views) {
    const Eigen::Vector3d d = Direction(view);
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - d * d.transpose();
    normal += across;
    right += across * (view.pose->center - origin);
  }
  const Eigen::LDLT<Eigen::Matrix3d> ldlt(normal);
  // The smallest pivot is about n sin^2 of the angle between the rays; 1e-10 stands for two arc seconds.
  if (ldlt.info() != Eigen::Success || !(ldlt.vectorD().minCoeff() > 1e-10)) return std::nullopt;
  const Eigen::Vector3d point = origin + ldlt.solve(right);
  return point.allFinite() ? std::optional(point) : std::nullopt;
}

std::optional<Eigen::Vector3d> RefineIntersection(std::span<const RayView> views, const Eigen::Vector3d& start,
                                                  int max_iterations) {
  Eigen::Vector3d point = start;
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    double depth = 0;
    for (const RayView& view : views) {
      const Eigen::Vector3d x = view.pose->rotation * point + view.pose->translation;
      if (!(x.z() > 0)) return std::nullopt;
      const double w = view.focal_px / x.z();
      const Eigen::Vector2d p = x.head<2>() / x.z();
      const auto& r = view.pose->rotation;
      Eigen::Matrix<double, 2, 3> j;
      j.row(0) = w * (r.row(0) - p.x() * r.row(2));
      j.row(1) = w * (r.row(1) - p.y() * r.row(2));
      normal += j.transpose() * j;
      right += j.transpose() * (view.focal_px * (view.normalized - p));
      depth = std::max(depth, x.z());
    }
    const Eigen::LDLT<Eigen::Matrix3d> ldlt(normal);
    if (ldlt.info() != Eigen::Success || !(ldlt.vectorD().minCoeff() > 0)) return std::nullopt;
    const Eigen::Vector3d step = ldlt.solve(right);
    if (!step.allFinite()) return std::nullopt;
    point += step;
    if (step.norm() < 1e-10 * depth) break;
  }
  for (const RayView& view : views)
    if (!((view.pose->rotation.row(2).dot(point) + view.pose->translation.z()) > 0)) return std::nullopt;
  return point;
}

std::optional<Intersection> IntersectRobustly(std::span<const RayView> views, const IntersectionOptions& options) {
  if (views.size() < 2) return std::nullopt;
  const auto finish = [&](const Eigen::Vector3d& point, Support support) -> std::optional<Intersection> {
    if (support.inliers < 2) return std::nullopt;
    const double angle = IntersectionAngle(Selected(views, support.is_inlier), point);
    if (angle < options.min_angle_rad) return std::nullopt;
    return Intersection{point, std::move(support.is_inlier), angle};
  };
  if (const auto point = Intersect(views)) {
    Support support = Score(views, *point, options.max_residual_px);
    if (support.inliers == static_cast<int>(views.size())) return finish(*point, std::move(support));
  }
  if (views.size() == 2) return std::nullopt;
  std::optional<Eigen::Vector3d> point = BestPairPoint(views, options);
  if (!point) return std::nullopt;
  Support support = Score(views, *point, options.max_residual_px);
  for (int round = 0; round < 3; ++round) {
    const auto refined = Intersect(Selected(views, support.is_inlier));
    if (!refined) break;
    Support next = Score(views, *refined, options.max_residual_px);
    if (!(next.cost < support.cost)) break;
    point = refined;
    support = std::move(next);
  }
  return finish(*point, std::move(support));
}

}  // namespace rilievo
