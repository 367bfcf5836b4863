// Two orthogonal matrices and the ratio of the singular values as the parameters of a fundamental matrix.
#include "geometry/fundamental_refinement.h"

#include <Eigen/Geometry>
#include <Eigen/SVD>

namespace rilievo {
namespace {

using Vector7 = Eigen::Matrix<double, 7, 1>;

struct FundamentalState {
  Eigen::Matrix3d u, v;
  double s = 0;

  Eigen::Matrix3d Matrix() const { return u.col(0) * v.col(0).transpose() + s * u.col(1) * v.col(1).transpose(); }
  Eigen::Matrix<double, 7, 9> Derivatives() const {
    const Eigen::Matrix3d f = Matrix();
    Eigen::Matrix<double, 7, 9> derivatives;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Matrix3d cross = CrossMatrix(Eigen::Vector3d::Unit(k));
      derivatives.row(k) = refinement_internal::RowMajor(cross * f).transpose();
      derivatives.row(3 + k) = refinement_internal::RowMajor(-f * cross).transpose();  // F (cross)'
    }
    derivatives.row(6) = refinement_internal::RowMajor(u.col(1) * v.col(1).transpose()).transpose();
    return derivatives;
  }
  FundamentalState Moved(const Vector7& delta) const {
    return {refinement_internal::SmallTurn(delta.head<3>()) * u,
            refinement_internal::SmallTurn(delta.segment<3>(3)) * v, s + delta[6]};
  }
};

}  // namespace

std::optional<Eigen::Matrix3d> RefineFundamental(const PairArrays& pairs, const CoordinateVariances& variances,
                                                 const Eigen::Matrix3d& start, const RefinementOptions& options) {
  if (!start.allFinite() || pairs.Size() < 7) return std::nullopt;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(start, Eigen::ComputeFullU | Eigen::ComputeFullV);
  if (!(svd.singularValues()[0] > 0)) return std::nullopt;
  const FundamentalState first{svd.matrixU(), svd.matrixV(), svd.singularValues()[1] / svd.singularValues()[0]};
  const auto refined = MinimiseSampson<7>(first, pairs, variances, options);
  if (!refined) return std::nullopt;
  const Eigen::Matrix3d f = refined->Matrix();
  if (!f.allFinite()) return std::nullopt;
  return Eigen::Matrix3d(f / f.norm());
}

}  // namespace rilievo
