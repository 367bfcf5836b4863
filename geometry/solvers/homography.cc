// Homographies by projective bases (four points) and by the normalised direct linear transform (many).
#include "geometry/solvers/homography.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "geometry/solvers/seven_point.h"

namespace rilievo {
namespace {

struct ProjectiveBasis {
  Eigen::Matrix3d columns;  // points 0, 1, 2
  Eigen::Vector3d weights;  // point 3 = columns * weights
};

std::optional<ProjectiveBasis> MakeBasis(const std::array<Eigen::Vector3d, 4>& p) {
  constexpr double kCollinear = 1e-10;
  const Eigen::Vector3d c12 = p[1].cross(p[2]), c20 = p[2].cross(p[0]), c01 = p[0].cross(p[1]);
  const double det = p[0].dot(c12);
  const Eigen::Vector3d numerators(p[3].dot(c12), p[3].dot(c20), p[3].dot(c01));
  if (!(std::min(std::abs(det), numerators.cwiseAbs().minCoeff()) > kCollinear)) return std::nullopt;
  ProjectiveBasis basis;
  basis.columns << p[0], p[1], p[2];
  basis.weights = numerators / det;
  return basis;
}

}  // namespace

std::optional<Eigen::Matrix3d> SolveHomographyFourPoint(const std::array<Eigen::Vector3d, 4>& first,
                                                        const std::array<Eigen::Vector3d, 4>& second) {
  const auto a = MakeBasis(first), b = MakeBasis(second);
  if (!a || !b) return std::nullopt;
  const Eigen::Vector3d scale = b->weights.cwiseQuotient(a->weights);
  // H first[i] = scale[i] second[i] (i < 3), H first[3] = second[3]: all of one sign, or some point is seen from
  // behind.
  if (!(scale.minCoeff() > 0)) return std::nullopt;
  Eigen::Matrix3d h = b->columns * scale.asDiagonal() * a->columns.inverse();
  h /= h.norm();
  if (!h.allFinite()) return std::nullopt;
  return h;
}

std::optional<Eigen::Matrix3d> SolveHomographyLinear(std::span<const Eigen::Vector2d> first,
                                                     std::span<const Eigen::Vector2d> second) {
  if (first.size() < 4) return std::nullopt;
  const Eigen::Matrix3d t1 = NormalizingTransform(first), t2 = NormalizingTransform(second);
  Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
  for (std::size_t i = 0; i < first.size(); ++i) {
    const Eigen::Vector3d x = t1 * first[i].homogeneous(), y = t2 * second[i].homogeneous();
    Eigen::Matrix<double, 9, 2> rows;
    rows << x, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero(), x, -y.x() * x, -y.y() * x;
    normal.selfadjointView<Eigen::Lower>().rankUpdate(rows);
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>> eigen(normal);
  if (eigen.info() != Eigen::Success || !(eigen.eigenvalues()[1] > 1e-12 * eigen.eigenvalues()[8])) return std::nullopt;
  const Eigen::Matrix<double, 9, 1> v = eigen.eigenvectors().col(0);
  Eigen::Matrix3d h = t2.inverse() * Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(v.data()) * t1;
  h /= h.norm();
  if (h.row(2).dot(first[0].homogeneous()) < 0) h = -h;
  if (!h.allFinite()) return std::nullopt;
  return h;
}

ModelList<Rigid3, 2> DecomposeHomography(const Eigen::Matrix3d& h) {
  ModelList<Rigid3, 2> poses;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(h, Eigen::ComputeFullV);
  const double middle = svd.singularValues()[1];
  if (!h.allFinite() || !(middle > 0)) return poses;
  const Eigen::Matrix3d unit = (h.determinant() < 0 ? -1 : 1) / middle * h;
  const double s1 = std::pow(svd.singularValues()[0] / middle, 2), s3 = std::pow(svd.singularValues()[2] / middle, 2);
  if (!(s1 - s3 > 1e-12)) return poses;
  const Eigen::Vector3d v1 = svd.matrixV().col(0), v2 = svd.matrixV().col(1), v3 = svd.matrixV().col(2);
  const double along = std::sqrt(std::max(0.0, 1 - s3) / (s1 - s3)),
               across = std::sqrt(std::max(0.0, s1 - 1) / (s1 - s3));
  for (const double sign : {1.0, -1.0}) {
    // H keeps the lengths of the plane spanned by v2 and u: there it acts as the rotation does.
    const Eigen::Vector3d u = along * v1 + sign * across * v3, normal = v2.cross(u);
    Eigen::Matrix3d before, after;
    before << v2, u, normal;
    after << unit * v2, unit * u, (unit * v2).cross(unit * u);
    const Eigen::Matrix3d rotation = after * before.transpose();
    const Eigen::Vector3d translation = (unit - rotation) * normal;
    if (translation.allFinite() && translation.norm() > 1e-9) poses.Add(Rigid3(rotation, translation.normalized()));
  }
  return poses;
}

}  // namespace rilievo
