// P3P by the degenerate conic of a pencil.
#include "geometry/solvers/p3p.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

namespace rilievo {
namespace {

Eigen::Matrix3d Adjugate(const Eigen::Matrix3d& m) {
  Eigen::Matrix3d cofactors;  // rows are cross products of rows: the cofactor matrix
  cofactors.row(0) = m.row(1).cross(m.row(2));
  cofactors.row(1) = m.row(2).cross(m.row(0));
  cofactors.row(2) = m.row(0).cross(m.row(1));
  return cofactors.transpose();
}

/// Real roots of x^3 + a x^2 + b x + c, polished by Newton's iteration; 1 or 3 of them.
std::vector<double> RealCubicRoots(double a, double b, double c) {
  const double shift = a / 3, p = b - a * a / 3, q = 2 * a * a * a / 27 - a * b / 3 + c;
  const double discriminant = q * q / 4 + p * p * p / 27;
  std::vector<double> roots;
  if (discriminant > 0) {
    const double s = std::sqrt(discriminant);
    const double u = std::cbrt(q > 0 ? -q / 2 - s : -q / 2 + s);  // the larger term: no cancellation
    roots.push_back(u - (u != 0 ? p / (3 * u) : 0) - shift);
  } else {
    const double radius = std::sqrt(std::max(0.0, -p / 3));
    const double cosine = radius > 0 ? std::clamp(-q / (2 * radius * radius * radius), -1.0, 1.0) : 0.0;
    for (int k = 0; k < 3; ++k)
      roots.push_back(2 * radius * std::cos((std::acos(cosine) + 2 * std::numbers::pi * k) / 3) - shift);
  }
  for (double& x : roots) {
    for (int i = 0; i < 4; ++i) {
      const double value = ((x + a) * x + b) * x + c, slope = (3 * x + 2 * a) * x + b;
      if (slope == 0 || !std::isfinite(value / slope)) break;
      x -= value / slope;
    }
  }
  return roots;
}

using LinePair = std::pair<Eigen::Vector3d, Eigen::Vector3d>;

/// The lines of the degenerate conic `d` = l m^T + m l^T (up to scale); `quality` tells how clearly they are two real
/// lines.
struct SplitConic {
  LinePair lines;
  double quality = 0;
};

std::optional<SplitConic> Split(const Eigen::Matrix3d& d) {
  const double scale = d.cwiseAbs().maxCoeff();
  if (!(scale > 0)) return std::nullopt;
  const Eigen::Matrix3d conic = d / scale, b = -Adjugate(conic);  // b = p p^T, p = l x m
  Eigen::Index i = 0;
  const double largest = b.diagonal().maxCoeff(&i);
  if (!(largest > 0)) return std::nullopt;  // conjugate complex lines
  const Eigen::Vector3d p = b.col(i) / std::sqrt(largest);
  Eigen::Matrix3d cross;
  cross << 0, -p.z(), p.y(), p.z(), 0, -p.x(), -p.y(), p.x(), 0;
  const Eigen::Matrix3d rank_one = conic + cross;
  Eigen::Index row = 0, col = 0;
  rank_one.cwiseAbs().maxCoeff(&row, &col);
  return SplitConic{{rank_one.row(row).transpose().normalized(), rank_one.col(col).normalized()}, largest};
}

/// Homogeneous points common to the line and the conic: 0 or 2.
std::vector<Eigen::Vector3d> Intersect(const Eigen::Vector3d& line, const Eigen::Matrix3d& conic) {
  const Eigen::Vector3d u = line.unitOrthogonal(), v = line.cross(u);
  const double a = u.dot(conic * u), b = u.dot(conic * v), c = v.dot(conic * v);
  double discriminant = b * b - a * c;
  const double size = std::max({std::abs(a), std::abs(b), std::abs(c)});
  if (discriminant < 0 && discriminant > -1e-12 * size * size) discriminant = 0;  // a double root, by rounding
  if (!(discriminant >= 0) || !(size > 0)) return {};
  const double q = -(b + std::copysign(std::sqrt(discriminant), b));  // a s^2 + 2 b s t + c t^2 = 0 in (s, t)
  return {q * u + a * v, c * u + q * v};
}

/// Newton's iteration on the three distances; none unless it ends at a solution with positive distances.
std::optional<Eigen::Vector3d> Polish(Eigen::Vector3d l, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  const double size = a.maxCoeff();
  double error = 0;
  for (int i = 0; i < 6; ++i) {
    const Eigen::Vector3d f(l[0] * l[0] + l[1] * l[1] - 2 * b[0] * l[0] * l[1] - a[0],
                            l[0] * l[0] + l[2] * l[2] - 2 * b[1] * l[0] * l[2] - a[1],
                            l[1] * l[1] + l[2] * l[2] - 2 * b[2] * l[1] * l[2] - a[2]);
    error = f.cwiseAbs().maxCoeff();
    if (error < 1e-15 * size || i == 5) break;
    Eigen::Matrix3d j;
    j << l[0] - b[0] * l[1], l[1] - b[0] * l[0], 0, l[0] - b[1] * l[2], 0, l[2] - b[1] * l[0], 0, l[1] - b[2] * l[2],
        l[2] - b[2] * l[1];
    const Eigen::Vector3d step = (2 * j).inverse() * f;
    if (!step.allFinite()) break;
    l -= step;
  }
  if (!(error < 1e-8 * size) || !(l.minCoeff() > 0)) return std::nullopt;
  return l;
}

Rigid3 PoseFromTriangles(const std::array<Eigen::Vector3d, 3>& x_cam, const std::array<Eigen::Vector3d, 3>& x_world) {
  const auto frame = [](const std::array<Eigen::Vector3d, 3>& x) {
    Eigen::Matrix3d f;
    f.col(0) = (x[1] - x[0]).normalized();
    f.col(2) = f.col(0).cross(x[2] - x[0]).normalized();
    f.col(1) = f.col(2).cross(f.col(0));
    return f;
  };
  const Eigen::Matrix3d rotation = frame(x_cam) * frame(x_world).transpose();
  const Eigen::Vector3d center_cam = (x_cam[0] + x_cam[1] + x_cam[2]) / 3;
  const Eigen::Vector3d center_world = (x_world[0] + x_world[1] + x_world[2]) / 3;
  const Eigen::Quaterniond q = Eigen::Quaterniond(rotation).normalized();
  return {q, center_cam - q * center_world};
}

/// The member of the pencil d1 + g d2 that splits best into two real lines.
std::optional<LinePair> BestLines(Eigen::Matrix3d d1, Eigen::Matrix3d d2) {
  if (std::abs(d1.determinant()) > std::abs(d2.determinant())) std::swap(d1, d2);
  const double c3 = d2.determinant(), c2 = (Adjugate(d2) * d1).trace(), c1 = (Adjugate(d1) * d2).trace(),
               c0 = d1.determinant();
  if (c3 == 0) return std::nullopt;
  std::optional<SplitConic> best;
  for (const double g : RealCubicRoots(c2 / c3, c1 / c3, c0 / c3)) {
    const auto split = Split(d1 + g * d2);
    if (split && (!best || split->quality > best->quality)) best = split;
  }
  return best ? std::optional(best->lines) : std::nullopt;
}

}  // namespace

std::vector<Rigid3> SolveP3p(const std::array<Eigen::Vector3d, 3>& rays_in_cam,
                             const std::array<Eigen::Vector3d, 3>& points_in_world) {
  const auto& y = rays_in_cam;
  const auto& x = points_in_world;
  const Eigen::Vector3d a_raw((x[0] - x[1]).squaredNorm(), (x[0] - x[2]).squaredNorm(), (x[1] - x[2]).squaredNorm());
  const double area = (x[1] - x[0]).cross(x[2] - x[0]).norm(), unit = a_raw.maxCoeff();
  if (!(unit > 0) || !(area > 1e-10 * unit)) return {};
  const Eigen::Vector3d a = a_raw / unit, b(y[0].dot(y[1]), y[0].dot(y[2]), y[1].dot(y[2]));
  Eigen::Matrix3d m01, m02, m12;
  m01 << 1, -b[0], 0, -b[0], 1, 0, 0, 0, 0;
  m02 << 1, 0, -b[1], 0, 0, 0, -b[1], 0, 1;
  m12 << 0, 0, 0, 0, 1, -b[2], 0, -b[2], 1;
  const Eigen::Matrix3d d1 = a[2] * m01 - a[0] * m12, d2 = a[2] * m02 - a[1] * m12;
  const auto lines = BestLines(d1, d2);
  if (!lines) return {};

  std::vector<Eigen::Vector3d> found;
  std::vector<Rigid3> poses;
  for (const auto& line : {lines->first, lines->second}) {
    for (Eigen::Vector3d l : Intersect(line, d1.norm() > d2.norm() ? d1 : d2)) {
      const double form = l.dot((m01 + m02 + m12) * l);  // equals the sum of a_ij at the right scale
      if (!(form > 0)) continue;
      l *= std::copysign(std::sqrt(a.sum() / form), l.sum());
      if (!(l.minCoeff() > 0)) continue;
      const auto polished = Polish(l, a, b);
      if (!polished) continue;
      const bool seen = std::any_of(found.begin(), found.end(), [&](const auto& other) {
        return (other - *polished).norm() < 1e-9 * polished->norm();
      });
      if (seen) continue;
      found.push_back(*polished);
      const Eigen::Vector3d depth = *polished * std::sqrt(unit);
      poses.push_back(PoseFromTriangles({depth[0] * y[0], depth[1] * y[1], depth[2] * y[2]}, x));
    }
  }
  return poses;
}

}  // namespace rilievo
