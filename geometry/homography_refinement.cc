// The nine entries of a homography as parameters, their common scale held by a constraint.
#include "geometry/homography_refinement.h"

#include <Eigen/LU>
#include <cmath>

namespace rilievo {
namespace {

using refinement_internal::Matrix9;
using refinement_internal::Vector9;

struct TransferEquations {
  Matrix9 normal = Matrix9::Zero();
  Vector9 right = Vector9::Zero();
  double cost = 0;
};

/// Of one direction: sum of M (x) P, M = (1, 0, -p_x; 0, 1, -p_y; -p_x, -p_y, p'p), P the products of the ray.
TransferEquations Expand(const TransferSums& sums) {
  constexpr int kProduct[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
  constexpr int kFactor[3][3] = {{0, -1, 1}, {-1, 0, 2}, {1, 2, 3}};
  TransferEquations equations;
  equations.cost = sums.behind > 0 ? INFINITY : sums.squares;
  for (int i = 0; i < 9; ++i) {
    equations.right[i] = sums.right[i];
    for (int j = 0; j < 9; ++j) {
      const int factor = kFactor[i / 3][j / 3];
      if (factor < 0) continue;
      const double sign = (i / 3 == 2) != (j / 3 == 2) ? -1 : 1;
      equations.normal(i, j) = sign * sums.normal[6 * factor + kProduct[i % 3][j % 3]];
    }
  }
  return equations;
}

/// Both directions; dH^-1 = -H^-1 dH H^-1.
TransferEquations Linearise(const Eigen::Matrix3d& h, const PairArrays& pairs, const CoordinateVariances& v,
                            const TwoViewKernels& kernels) {
  TransferSums there, back;
  const Eigen::Matrix3d g = h.inverse();
  kernels.transfer_sums(refinement_internal::RowMajor(h).data(), pairs.Columns(), there);
  kernels.transfer_sums(refinement_internal::RowMajor(g).data(), pairs.Reversed(), back);
  TransferEquations equations = Expand(there);
  const TransferEquations reverse = Expand(back);
  Matrix9 chain;
  for (int i = 0; i < 9; ++i) {
    for (int j = 0; j < 9; ++j) chain(i, j) = -g(i / 3, j / 3) * g(j % 3, i % 3);
  }
  const double w2 = 0.5 / v.second, w1 = 0.5 / v.first;
  equations.normal = w2 * equations.normal + w1 * (chain.transpose() * reverse.normal * chain);
  equations.right = w2 * equations.right + w1 * (chain.transpose() * reverse.right);
  equations.cost = w2 * equations.cost + w1 * reverse.cost;
  return equations;
}

}  // namespace

std::optional<Eigen::Matrix3d> RefineHomography(const PairArrays& pairs, const CoordinateVariances& variances,
                                                const Eigen::Matrix3d& start, const RefinementOptions& options) {
  if (!start.allFinite() || pairs.Size() < 4) return std::nullopt;
  const TwoViewKernels& kernels = options.kernels != nullptr ? *options.kernels : ActiveTwoViewKernels();
  Eigen::Matrix3d h = start / start.norm();
  const PairColumns columns = pairs.Columns();
  if (h.row(2).dot(Eigen::Vector3d(columns.x1[0], columns.y1[0], 1)) < 0) h = -h;
  TransferEquations at = Linearise(h, pairs, variances, kernels);
  if (!std::isfinite(at.cost)) return std::nullopt;
  double damping = 1e-4;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    const Vector9 gauge = refinement_internal::RowMajor(h);
    double decrease = -1;
    for (int tries = 0; tries < 6 && decrease < 0; ++tries, damping *= 10) {
      Matrix9 matrix = at.normal;
      matrix.diagonal() *= 1 + damping;
      matrix += at.normal.trace() / 9 * gauge * gauge.transpose();
      const Vector9 delta = matrix.ldlt().solve(-at.right);
      if (!delta.allFinite()) continue;
      Eigen::Matrix3d next = h + Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(delta.data());
      next /= next.norm();
      const TransferEquations there = Linearise(next, pairs, variances, kernels);
      if (!(there.cost < at.cost)) continue;
      decrease = (at.cost - there.cost) / at.cost;
      h = next;
      at = there;
      damping *= 0.01;
    }
    if (decrease < options.relative_decrease) break;
  }
  return h;
}

}  // namespace rilievo
