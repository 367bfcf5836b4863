// The collinearity equations of one image point with their derivatives.
#pragma once

#include <ceres/manifold.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Core>

#include "geometry/camera_model.h"
#include "geometry/rigid3.h"

namespace rilievo::adjustment {

/// An exterior orientation as Ceres holds it: quaternion x y z w, then the translation of cam_from_world.
inline constexpr int kPoseSize = 7;
/// Increments of a pose: rotation vector w (R' = exp(w) R, camera frame), then the translation's.
inline constexpr int kPoseIncrements = 6;

/// Residual projected - measured in px; derivatives to the pose's increments (in the first six of seven columns, see
/// PoseManifold) and to the point, as collinearity.h has them.
class Reprojection final : public ceres::SizedCostFunction<2, kPoseSize, 3> {
 public:
  /// `camera` must outlive the object.
  Reprojection(const CameraModel& camera, const Eigen::Vector2d& measured_px)
      : camera_(&camera), measured_px_(measured_px) {}
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  const CameraModel* camera_;
  Eigen::Vector2d measured_px_;
};

/// The plus operation above. Reprojection delivers derivatives to the increments already, so the plus Jacobian is the
/// identity over a zero row, which spares a quaternion's chain rule an observation (Ceres: "on-manifold derivatives").
/// `held` (0..5, or -1) names an increment that stays zero: the datum's scale. Its column is zeroed rather than left
/// out, so that all blocks keep the size 6 for which Ceres has fixed-size code.
class PoseManifold final : public ceres::Manifold {
 public:
  explicit PoseManifold(int held = -1) : held_(held) {}
  int AmbientSize() const override { return kPoseSize; }
  int TangentSize() const override { return kPoseIncrements; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;

 private:
  int held_;
};

}  // namespace rilievo::adjustment
