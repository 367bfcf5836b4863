// Levenberg-Marquardt over rotation and direction of translation, with the analytic Jacobian of the Sampson distance.
#include "geometry/essential_refinement.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>

namespace rilievo {
namespace {

using Vector5 = Eigen::Matrix<double, 5, 1>;
using Matrix5 = Eigen::Matrix<double, 5, 5>;

struct State {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;  // unit
  Eigen::Matrix3d Essential() const { return CrossMatrix(translation) * rotation; }
};

/// Two unit vectors that span the plane tangent to the sphere at t.
Eigen::Matrix<double, 3, 2> TangentBasis(const Eigen::Vector3d& t) {
  int smallest = 0;
  t.cwiseAbs().minCoeff(&smallest);
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = t.cross(Eigen::Vector3d::Unit(smallest)).normalized();
  basis.col(1) = t.cross(basis.col(0));
  return basis;
}

State Step(const State& state, const Vector5& delta) {
  const Eigen::Vector3d w = delta.head<3>();
  const double angle = w.norm();
  State next = state;
  if (angle > 0) next.rotation = Eigen::AngleAxisd(angle, w / angle).toRotationMatrix() * state.rotation;
  next.translation = (state.translation + TangentBasis(state.translation) * delta.tail<2>()).normalized();
  return next;
}

double Cost(const Eigen::Matrix3d& e, std::span<const Eigen::Vector2d> first, std::span<const Eigen::Vector2d> second,
            const CoordinateVariances& v) {
  double cost = 0;
  for (std::size_t i = 0; i < first.size(); ++i) cost += SquaredSampson(e, first[i], second[i], v);
  return cost;
}

struct NormalEquations {
  Matrix5 matrix = Matrix5::Zero();
  Vector5 right = Vector5::Zero();
};

/// r = y'Ex / sqrt(D), D = v1 (c^2 + d^2) + v2 (a^2 + b^2) with (a, b) = (Ex)_12, (c, d) = (E'y)_12. Its derivative by
/// E is
///   G = y x' / sqrt(D) - (y'Ex) / D^(3/2) (v2 (a, b, 0)' x' + v1 y (c, d, 0)),
/// and each parameter's derivative is the inner product of G and dE/dparameter.
NormalEquations Linearize(const State& state, std::span<const Eigen::Vector2d> first,
                          std::span<const Eigen::Vector2d> second, const CoordinateVariances& v) {
  const Eigen::Matrix3d e = state.Essential();
  const Eigen::Matrix<double, 3, 2> tangent = TangentBasis(state.translation);
  Eigen::Matrix<double, 5, 9> derivatives;  // dE/dparameter, column-major E
  for (int k = 0; k < 5; ++k) {
    const Eigen::Matrix3d d =
        k < 3 ? Eigen::Matrix3d(CrossMatrix(state.translation) * CrossMatrix(Eigen::Vector3d::Unit(k)) * state.rotation)
              : Eigen::Matrix3d(CrossMatrix(tangent.col(k - 3)) * state.rotation);
    derivatives.row(k) = Eigen::Map<const Eigen::Matrix<double, 1, 9>>(d.data());
  }
  NormalEquations sum;
  for (std::size_t i = 0; i < first.size(); ++i) {
    const Eigen::Vector3d x = first[i].homogeneous(), y = second[i].homogeneous();
    Eigen::Vector3d line = e * x, back = e.transpose() * y;
    const double error = y.dot(line);
    line.z() = back.z() = 0;
    const double d = v.first * back.squaredNorm() + v.second * line.squaredNorm();
    if (!(d > 0)) continue;
    const double scale = 1 / std::sqrt(d), share = error / d;
    const Eigen::Vector3d left = y - (share * v.second) * line;
    Eigen::Matrix3d gradient = left * x.transpose() - y * ((share * v.first) * back).transpose();
    gradient *= scale;
    const Vector5 j = derivatives * Eigen::Map<const Eigen::Matrix<double, 9, 1>>(gradient.data());
    sum.matrix.noalias() += j * j.transpose();
    sum.right.noalias() += j * (error * scale);
  }
  return sum;
}

}  // namespace

std::optional<Eigen::Matrix3d> RefineEssential(std::span<const Eigen::Vector2d> first,
                                               std::span<const Eigen::Vector2d> second,
                                               const CoordinateVariances& variances, const Eigen::Matrix3d& start,
                                               const EssentialRefinementOptions& options) {
  if (!start.allFinite() || first.size() < 5) return std::nullopt;
  const Rigid3 pose = DecomposeEssential(start)[0];  // any of the four: E is what counts
  State state{pose.RotationMatrix(), pose.translation.normalized()};
  double cost = Cost(state.Essential(), first, second, variances);
  if (!std::isfinite(cost)) return std::nullopt;
  double damping = 1e-4;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    const NormalEquations normal = Linearize(state, first, second, variances);
    bool lowered = false;
    double decrease = 0;
    for (int tries = 0; tries < 6 && !lowered; ++tries, damping *= 10) {
      Matrix5 matrix = normal.matrix;
      matrix.diagonal() += damping * normal.matrix.diagonal() + Vector5::Constant(1e-300);
      const Vector5 delta = matrix.ldlt().solve(-normal.right);
      if (!delta.allFinite()) continue;
      const State next = Step(state, delta);
      const double next_cost = Cost(next.Essential(), first, second, variances);
      if (!(next_cost < cost)) continue;
      decrease = (cost - next_cost) / cost;
      state = next;
      cost = next_cost;
      damping *= 0.01;
      lowered = true;
    }
    if (!lowered || decrease < options.relative_decrease) break;
  }
  const Eigen::Matrix3d essential = state.Essential();
  if (!essential.allFinite()) return std::nullopt;
  return Eigen::Matrix3d(essential / essential.norm());
}

}  // namespace rilievo
