// The seven-point solver and the normalised eight-point method.
#include "geometry/solvers/seven_point.h"

#include <Eigen/Dense>
#include <cmath>
#include <numbers>

#include "geometry/solvers/null_space.h"
#include "geometry/solvers/real_roots.h"

namespace rilievo {
namespace {

Eigen::Matrix3d FromRowMajor(const std::array<double, 9>& v) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(v.data());
}

}  // namespace

FundamentalList SolveSevenPoint(const std::array<Eigen::Vector3d, 7>& first,
                                const std::array<Eigen::Vector3d, 7>& second) {
  std::array<std::array<double, 9>, 7> rows;
  for (std::size_t i = 0; i < 7; ++i) {
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) rows[i][3 * r + c] = second[i][r] * first[i][c];
    }
  }
  const auto basis = NullSpace9<7>(rows);
  const Eigen::Matrix3d a = FromRowMajor(basis[0]), b = FromRowMajor(basis[1]);
  // det(a + x b) by the determinants that take one or two columns of b.
  const auto mixed = [](const Eigen::Matrix3d& p, const Eigen::Matrix3d& q) {
    return q.col(0).dot(p.col(1).cross(p.col(2))) + p.col(0).dot(q.col(1).cross(p.col(2))) +
           p.col(0).dot(p.col(1).cross(q.col(2)));
  };
  FundamentalList solutions;
  for (const double x : RealRoots<3>({a.determinant(), mixed(a, b), mixed(b, a), b.determinant()})) {
    Eigen::Matrix3d f = a + x * b;
    f /= f.norm();
    if (f.allFinite()) solutions.Add(f);
  }
  return solutions;
}

Eigen::Matrix3d NormalizingTransform(std::span<const Eigen::Vector2d> points) {
  const double n = static_cast<double>(points.size());
  Eigen::Vector2d center = Eigen::Vector2d::Zero();
  for (const auto& p : points) center += p / n;
  double distance = 0;
  for (const auto& p : points) distance += (p - center).norm() / n;
  const double scale = distance > 0 ? std::numbers::sqrt2 / distance : 1;
  Eigen::Matrix3d transform;
  transform << scale, 0, -scale * center.x(), 0, scale, -scale * center.y(), 0, 0, 1;
  return transform;
}

std::optional<Eigen::Matrix3d> SolveEightPoint(std::span<const Eigen::Vector2d> first,
                                               std::span<const Eigen::Vector2d> second, std::span<const double> weights,
                                               EpipolarKind kind) {
  if (first.size() < 8) return std::nullopt;
  const Eigen::Matrix3d t1 = NormalizingTransform(first), t2 = NormalizingTransform(second);
  Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
  for (std::size_t i = 0; i < first.size(); ++i) {
    const Eigen::Vector3d x = t1 * first[i].homogeneous(), y = t2 * second[i].homogeneous();
    Eigen::Matrix<double, 9, 1> row;
    row << y.x() * x, y.y() * x, y.z() * x;
    normal.selfadjointView<Eigen::Lower>().rankUpdate(row, weights.empty() ? 1.0 : weights[i]);
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>> eigen(normal);
  if (eigen.info() != Eigen::Success || !(eigen.eigenvalues()[1] > 1e-12 * eigen.eigenvalues()[8])) return std::nullopt;
  const Eigen::Matrix<double, 9, 1> v = eigen.eigenvectors().col(0);
  Eigen::Matrix3d model = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(v.data());
  if (kind == EpipolarKind::kEssential)
    model = t2.transpose() * model * t1;  // its constraint holds in the rays' own frame
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(model, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d s = svd.singularValues();
  s = kind == EpipolarKind::kEssential ? Eigen::Vector3d(1, 1, 0) : Eigen::Vector3d(s[0], s[1], 0);
  model = svd.matrixU() * s.asDiagonal() * svd.matrixV().transpose();
  if (kind == EpipolarKind::kFundamental) model = t2.transpose() * model * t1;
  model /= model.norm();
  if (!model.allFinite()) return std::nullopt;
  return model;
}

}  // namespace rilievo
