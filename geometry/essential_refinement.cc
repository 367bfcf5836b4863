// Rotation and direction of translation as the parameters of an essential matrix.
#include "geometry/essential_refinement.h"

#include <Eigen/Geometry>

namespace rilievo {
namespace {

using Vector5 = Eigen::Matrix<double, 5, 1>;

/// Two unit vectors that span the plane tangent to the sphere at t.
Eigen::Matrix<double, 3, 2> TangentBasis(const Eigen::Vector3d& t) {
  int smallest = 0;
  t.cwiseAbs().minCoeff(&smallest);
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = t.cross(Eigen::Vector3d::Unit(smallest)).normalized();
  basis.col(1) = t.cross(basis.col(0));
  return basis;
}

struct EssentialState {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;  // unit

  Eigen::Matrix3d Matrix() const { return CrossMatrix(translation) * rotation; }
  Eigen::Matrix<double, 5, 9> Derivatives() const {
    const Eigen::Matrix<double, 3, 2> tangent = TangentBasis(translation);
    const Eigen::Matrix3d cross = CrossMatrix(translation);
    Eigen::Matrix<double, 5, 9> derivatives;
    for (int k = 0; k < 5; ++k) {
      const Eigen::Matrix3d d = k < 3 ? Eigen::Matrix3d(cross * CrossMatrix(Eigen::Vector3d::Unit(k)) * rotation)
                                      : Eigen::Matrix3d(CrossMatrix(tangent.col(k - 3)) * rotation);
      derivatives.row(k) = refinement_internal::RowMajor(d).transpose();
    }
    return derivatives;
  }
  EssentialState Moved(const Vector5& delta) const {
    return {refinement_internal::SmallTurn(delta.head<3>()) * rotation,
            (translation + TangentBasis(translation) * delta.tail<2>()).normalized()};
  }
};

}  // namespace

std::optional<Eigen::Matrix3d> RefineEssential(const PairArrays& pairs, const CoordinateVariances& variances,
                                               const Eigen::Matrix3d& start, const RefinementOptions& options) {
  if (!start.allFinite() || pairs.Size() < 5) return std::nullopt;
  const Rigid3 pose = DecomposeEssential(start)[0];  // any of the four: E is what counts
  const EssentialState first{pose.RotationMatrix(), pose.translation.normalized()};
  const auto refined = MinimiseSampson<5>(first, pairs, variances, options);
  if (!refined) return std::nullopt;
  const Eigen::Matrix3d essential = refined->Matrix();
  if (!essential.allFinite()) return std::nullopt;
  return Eigen::Matrix3d(essential / essential.norm());
}

}  // namespace rilievo
