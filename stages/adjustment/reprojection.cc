// Collinearity equations, analytic derivatives, pose increments.
#include "stages/adjustment/reprojection.h"

#include <Eigen/Geometry>
#include <cmath>

#include "stages/adjustment/collinearity.h"

namespace rilievo::adjustment {
namespace {

using PoseJacobian = Eigen::Matrix<double, 2, kPoseSize, Eigen::RowMajor>;
using PointJacobian = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;

}  // namespace

Eigen::Quaterniond RotationExp(const Eigen::Vector3d& w) {
  const double angle = w.norm(), half = 0.5 * angle;
  const double s = angle > 1e-8 ? std::sin(half) / angle : 0.5;
  return {std::cos(half), s * w.x(), s * w.y(), s * w.z()};
}

bool Reprojection::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  const Eigen::Map<const Eigen::Quaterniond> q(parameters[0]);
  const Eigen::Map<const Eigen::Vector3d> t(parameters[0] + 4), point(parameters[1]);
  const Eigen::Matrix3d r = q.toRotationMatrix();
  const Collinearity c = Linearize(*camera_, r, t, point, measured_px_);
  Eigen::Map<Eigen::Vector2d>{residuals} = c.residual_px;
  if (jacobians == nullptr) return true;
  if (jacobians[0] != nullptr) {
    Eigen::Map<PoseJacobian> j(jacobians[0]);
    j.leftCols<6>() = ByPose(c);
    j.col(6).setZero();
  }
  if (jacobians[1] != nullptr) Eigen::Map<PointJacobian>{jacobians[1]} = c.by_camera_point * r;
  return true;
}

bool PoseManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  double d[kPoseIncrements];
  for (int i = 0; i < kPoseIncrements; ++i) d[i] = i == held_ ? 0.0 : delta[i];
  const Eigen::Map<const Eigen::Quaterniond> q(x);
  Eigen::Map<Eigen::Quaterniond> out(x_plus_delta);
  out = (RotationExp({d[0], d[1], d[2]}) * q).normalized();
  for (int i = 0; i < 3; ++i) x_plus_delta[4 + i] = x[4 + i] + d[3 + i];
  return true;
}

bool PoseManifold::PlusJacobian(const double*, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, kPoseSize, kPoseIncrements, Eigen::RowMajor>> j(jacobian);
  j.setZero();
  for (int i = 0; i < kPoseIncrements; ++i) j(i, i) = i == held_ ? 0 : 1;
  return true;
}

bool PoseManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  const Eigen::Map<const Eigen::Quaterniond> qy(y), qx(x);
  const Eigen::AngleAxisd turn(qy * qx.conjugate());
  const Eigen::Vector3d w = turn.angle() * turn.axis();
  for (int i = 0; i < 3; ++i) y_minus_x[i] = w[i], y_minus_x[3 + i] = y[4 + i] - x[4 + i];
  if (held_ >= 0) y_minus_x[held_] = 0;
  return true;
}

bool PoseManifold::MinusJacobian(const double*, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, kPoseIncrements, kPoseSize, Eigen::RowMajor>> j(jacobian);
  j.setZero();
  for (int i = 0; i < kPoseIncrements; ++i) j(i, i) = i == held_ ? 0 : 1;
  return true;
}

}  // namespace rilievo::adjustment
