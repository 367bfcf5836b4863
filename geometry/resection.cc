// P3P inside the robust loop, Levenberg-Marquardt after it.
#include "geometry/resection.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <limits>

#include "base/check.h"
#include "geometry/robust/estimate.h"
#include "geometry/solvers/model_list.h"
#include "geometry/solvers/p3p.h"
#include "geometry/triangulation.h"

namespace rilievo {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

struct NormalEquations {
  Matrix6 normal = Matrix6::Zero();
  Vector6 right = Vector6::Zero();
  double cost = 0;
};

/// Cauchy's loss, or squares for scale 0.
double Loss(double squared, double scale) {
  return scale > 0 ? scale * scale * std::log1p(squared / (scale * scale)) : squared;
}
double Weight(double squared, double scale) { return scale > 0 ? 1 / (1 + squared / (scale * scale)) : 1; }

/// None when a point is not in front of the camera.
std::optional<NormalEquations> Linearise(const ResectionInput& input, std::span<const std::uint32_t> items,
                                         const CameraPose& pose, double scale) {
  NormalEquations equations;
  for (const std::uint32_t item : items) {
    const Eigen::Vector3d rotated = pose.rotation * input.points_in_world[item], x = rotated + pose.translation;
    if (!(x.z() > 0)) return std::nullopt;
    const Eigen::Vector2d p = x.head<2>() / x.z();
    const Eigen::Vector2d residual = input.focal_px * (input.normalized[item] - p);
    const double squared = residual.squaredNorm(), weight = Weight(squared, scale), f = input.focal_px / x.z();
    Eigen::Matrix<double, 2, 6> j;
    const Eigen::Vector3d gx(f, 0, -f * p.x()), gy(0, f, -f * p.y());
    j << rotated.cross(gx).transpose(), gx.transpose(), rotated.cross(gy).transpose(), gy.transpose();
    equations.normal.noalias() += weight * j.transpose() * j;
    equations.right.noalias() += weight * j.transpose() * residual;
    equations.cost += Loss(squared, scale);
  }
  return equations;
}

Rigid3 Moved(const Rigid3& pose, const Vector6& step) {
  const double angle = step.head<3>().norm();
  const Eigen::Quaterniond turn(angle > 0 ? Eigen::AngleAxisd(angle, step.head<3>() / angle)
                                          : Eigen::AngleAxisd::Identity());
  return {turn * pose.rotation, pose.translation + step.tail<3>()};
}

/// The robust loop's view of a resection.
class ResectionProblem {
 public:
  struct Model {
    Rigid3 rigid;
    CameraPose pose;
  };
  static constexpr int kSampleSize = 3;

  explicit ResectionProblem(const ResectionInput& input) : input_(input) {}
  std::size_t Size() const { return input_.normalized.size(); }

  ModelList<Model, 4> Solve(const std::array<std::uint32_t, 3>& sample) const {
    std::array<Eigen::Vector3d, 3> rays, points;
    for (std::size_t k = 0; k < 3; ++k) {
      rays[k] = input_.normalized[sample[k]].homogeneous().normalized();
      points[k] = input_.points_in_world[sample[k]];
    }
    ModelList<Model, 4> models;
    for (const Rigid3& pose : SolveP3p(rays, points)) models.Add({pose, CameraPose(pose)});
    return models;
  }

  double SquaredResidual(const Model& model, std::size_t i) const {
    const double r = RayResidualPx({&model.pose, input_.normalized[i], input_.focal_px}, input_.points_in_world[i]);
    return r * r;
  }

  std::optional<Model> Refine(std::span<const std::uint32_t> items, const Model& start) const {
    const auto refined = RefineResection(input_, items, start.rigid, 0, 5);
    return refined ? std::optional(Model{*refined, CameraPose(*refined)}) : std::nullopt;
  }

 private:
  const ResectionInput& input_;
};

}  // namespace

std::optional<Rigid3> RefineResection(const ResectionInput& input, std::span<const std::uint32_t> items,
                                      const Rigid3& start, double loss_scale_px, int max_iterations) {
  Rigid3 pose = start;
  auto at = Linearise(input, items, CameraPose(pose), loss_scale_px);
  if (!at) return std::nullopt;
  double damping = 1e-6;
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    Matrix6 damped = at->normal;
    damped.diagonal() *= 1 + damping;
    const Eigen::LDLT<Matrix6> ldlt(damped);
    if (ldlt.info() != Eigen::Success || !(ldlt.vectorD().minCoeff() > 0)) return std::nullopt;
    const Vector6 step = ldlt.solve(at->right);
    if (!step.allFinite()) return std::nullopt;
    const Rigid3 next = Moved(pose, step);
    auto there = Linearise(input, items, CameraPose(next), loss_scale_px);
    if (there && there->cost <= at->cost) {
      const bool settled = at->cost - there->cost <= 1e-12 * at->cost;
      pose = next;
      at = std::move(there);
      if (settled) break;
      damping = std::max(1e-9, damping / 10);
    } else {
      damping *= 10;
      if (damping > 1e6) break;
    }
  }
  return pose;
}

std::optional<Resection> EstimateResection(const ResectionInput& input, const ResectionOptions& options,
                                           std::uint64_t seed) {
  RILIEVO_CHECK(input.points_in_world.size() == input.normalized.size());
  if (input.normalized.size() < 4) return std::nullopt;
  const ResectionProblem problem(input);
  RobustOptions robust;
  robust.estimator = RobustEstimator::kMapsac;
  robust.threshold = options.max_residual_px;
  robust.confidence = options.confidence;
  robust.max_trials = options.max_trials;
  robust.min_trials = 20;
  robust.context = options.context;
  const auto estimate = EstimateRobustly(problem, robust, seed);
  if (!estimate || estimate->inliers.size() < 4) return std::nullopt;
  const auto refined = RefineResection(input, estimate->inliers, estimate->model.rigid, 0.5 * options.max_residual_px);
  const Rigid3 pose = refined.value_or(estimate->model.rigid);
  const CameraPose camera(pose);
  Resection resection{pose, {}};
  for (std::uint32_t i = 0; i < input.normalized.size(); ++i)
    if (RayResidualPx({&camera, input.normalized[i], input.focal_px}, input.points_in_world[i]) <=
        options.max_residual_px)
      resection.inliers.push_back(i);
  if (resection.inliers.size() < 4) return std::nullopt;
  return resection;
}

}  // namespace rilievo
