// Levenberg-Marquardt on squared Sampson distances over any parametrisation of a 3 x 3 matrix.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <optional>

#include "geometry/epipolar.h"
#include "geometry/pair_arrays.h"

namespace rilievo {

struct RefinementOptions {
  int max_iterations = 20;
  double relative_decrease = 1e-10;         ///< stop once the cost falls by less
  const TwoViewKernels* kernels = nullptr;  ///< those of RILIEVO_KERNELS when absent
};

namespace refinement_internal {

using Matrix9 = Eigen::Matrix<double, 9, 9>;
using Vector9 = Eigen::Matrix<double, 9, 1>;

inline Vector9 RowMajor(const Eigen::Matrix3d& m) {
  return (Vector9() << m.row(0).transpose(), m.row(1).transpose(), m.row(2).transpose()).finished();
}

/// A rotation of about w for small w, without the sine and cosine whose last digit is not the same on all processors.
inline Eigen::Matrix3d SmallTurn(const Eigen::Vector3d& w) {
  return Eigen::Quaterniond(1, 0.5 * w.x(), 0.5 * w.y(), 0.5 * w.z()).normalized().toRotationMatrix();
}

inline Matrix9 Symmetric(const double* upper) {
  Matrix9 m;
  for (int i = 0; i < 9; ++i) {
    for (int j = i; j < 9; ++j) m(i, j) = m(j, i) = *upper++;
  }
  return m;
}

}  // namespace refinement_internal

/// What the method needs of a state with N parameters:
///   Matrix()       the matrix
///   Derivatives()  N x 9, dmatrix / dparameter, row-major
///   Moved(delta)   the state after that step
/// The kernels sum over the points in the nine entries of the matrix (MatrixSums); the parameters' normal equations
/// follow by the chain rule. The cost never rises; none when it is not finite at the start.
template <int N, class State>
std::optional<State> MinimiseSampson(State state, const PairArrays& pairs, const CoordinateVariances& variances,
                                     const RefinementOptions& options) {
  using Vector = Eigen::Matrix<double, N, 1>;
  using Square = Eigen::Matrix<double, N, N>;
  const TwoViewKernels& kernels = options.kernels != nullptr ? *options.kernels : ActiveTwoViewKernels();
  const PairColumns columns = pairs.Columns();
  const auto sums_at = [&](const State& at) {
    MatrixSums sums;
    kernels.sampson_sums(refinement_internal::RowMajor(at.Matrix()).data(), variances.first, variances.second, columns,
                         sums);
    return sums;
  };
  MatrixSums at = sums_at(state);
  if (!std::isfinite(at.squares)) return std::nullopt;
  double damping = 1e-4;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    const Eigen::Matrix<double, N, 9> derivatives = state.Derivatives();
    const Eigen::Matrix<double, N, 9> half = derivatives.lazyProduct(refinement_internal::Symmetric(at.normal));
    const Square normal = half.lazyProduct(derivatives.transpose());
    const Vector right = derivatives.lazyProduct(Eigen::Map<const refinement_internal::Vector9>(at.right));
    double decrease = -1;
    for (int tries = 0; tries < 6 && decrease < 0; ++tries, damping *= 10) {
      Square matrix = normal;
      matrix.diagonal() += damping * normal.diagonal() + Vector::Constant(1e-300);
      const Vector delta = matrix.ldlt().solve(-right);
      if (!delta.allFinite()) continue;
      const State next = state.Moved(delta);
      const MatrixSums there = sums_at(next);
      if (!(there.squares < at.squares)) continue;
      decrease = (at.squares - there.squares) / at.squares;
      state = next;
      at = there;
      damping *= 0.01;
    }
    if (decrease < options.relative_decrease) break;
  }
  return state;
}

}  // namespace rilievo
