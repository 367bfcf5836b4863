// Builds Ceres' problem and solves it (sparse or dense Schur complement, one thread).
#include "stages/adjustment/ceres_solver.h"

#include <ceres/ceres.h>
#include <glog/logging.h>

#include <array>
#include <deque>
#include <memory>

#include "stages/adjustment/reprojection.h"

namespace rilievo::adjustment {
namespace {

class StopCallback final : public ceres::IterationCallback {
 public:
  explicit StopCallback(const RunContext& context) : context_(context) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary&) override {
    return context_.StopRequested() ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
  }

 private:
  const RunContext& context_;
};

std::unique_ptr<ceres::LossFunction> MakeLoss(const BundleOptions& options) {
  if (options.loss == Loss::kHuber) return std::make_unique<ceres::HuberLoss>(options.loss_scale_px);
  if (options.loss == Loss::kCauchy) return std::make_unique<ceres::CauchyLoss>(options.loss_scale_px);
  return nullptr;
}

/// Ceres' problem with the objects it refers to; costs lie side by side and live as long as the problem.
struct CeresProblem {
  /// By image: all side by side, because Ceres orders the elimination by address, and with it every sum.
  std::vector<std::array<double, kPoseSize>> poses;
  std::deque<Reprojection> costs;
  std::deque<PoseManifold> manifolds;
  std::unique_ptr<ceres::LossFunction> loss;
  std::unique_ptr<ceres::Problem> problem;
  std::shared_ptr<ceres::ParameterBlockOrdering> ordering;
};

void Constrain(BundleProblem& bundle, CeresProblem& p) {
  std::vector<std::uint8_t> image_used(bundle.images.size(), 0);
  for (const BundleRay& ray : bundle.rays) image_used[ray.image] = 1;
  p.ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (std::size_t j = 0; j < bundle.points.size(); ++j) {
    if (bundle.first_ray[j] == bundle.first_ray[j + 1]) continue;
    p.ordering->AddElementToGroup(bundle.points[j].data(), 0);
    if (bundle.fix_points) p.problem->SetParameterBlockConstant(bundle.points[j].data());
  }
  for (std::size_t i = 0; i < bundle.images.size(); ++i) {
    if (!image_used[i]) continue;
    double* pose = p.poses[i].data();
    p.problem->SetManifold(pose, &p.manifolds.emplace_back(bundle.images[i].held));
    if (bundle.images[i].is_fixed) p.problem->SetParameterBlockConstant(pose);
    p.ordering->AddElementToGroup(pose, 1);
  }
}

CeresProblem MakeProblem(BundleProblem& bundle, const BundleOptions& options) {
  CeresProblem p;
  for (const BundleImage& image : bundle.images) {
    const auto& q = image.rotation;
    const auto& t = image.translation;
    p.poses.push_back({q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z()});
  }
  p.loss = MakeLoss(options);
  ceres::Problem::Options ceres_options;
  ceres_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres_options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres_options.disable_all_safety_checks = true;
  p.problem = std::make_unique<ceres::Problem>(ceres_options);
  for (std::size_t j = 0; j < bundle.points.size(); ++j) {
    for (std::size_t k = bundle.first_ray[j]; k < bundle.first_ray[j + 1]; ++k) {
      const BundleRay& ray = bundle.rays[k];
      Reprojection& cost = p.costs.emplace_back(*bundle.images[ray.image].camera, ray.measured_px);
      p.problem->AddResidualBlock(&cost, p.loss.get(), p.poses[ray.image].data(), bundle.points[j].data());
    }
  }
  Constrain(bundle, p);
  return p;
}

/// Ceres writes a warning to stderr for every step that a singular system refuses, hundreds of lines in a degenerate
/// block. A refused step is a part of the method and the outcome is in the summary; the program's errors are lines of
/// its own. The library knows no other switch than this one for the process.
void SilenceLibraryLog() {
  static const bool done = [] {
    FLAGS_minloglevel = google::GLOG_ERROR;
    return true;
  }();
  static_cast<void>(done);
}

}  // namespace

BundleSummary SolveWithCeres(BundleProblem& bundle, const BundleOptions& options, std::size_t most_images_dense,
                             RunContext& context) {
  CeresProblem p = MakeProblem(bundle, options);
  ceres::Solver::Options solver;
  // Eigen's solvers only: a BLAS may use threads and picks its kernels by processor, and both change the last bits.
  solver.linear_solver_type = bundle.images.size() <= most_images_dense ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
  solver.dense_linear_algebra_library_type = ceres::EIGEN;
  solver.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  solver.num_threads = 1;  // threaded sums depend on the order of arrival
  solver.max_num_iterations = options.max_iterations;
  solver.function_tolerance = options.function_tolerance;
  solver.gradient_tolerance = 1e-12;
  solver.parameter_tolerance = 1e-12;
  solver.logging_type = ceres::SILENT;
  solver.linear_solver_ordering = p.ordering;
  StopCallback stop(context);
  solver.callbacks.push_back(&stop);
  SilenceLibraryLog();
  const std::vector<Eigen::Vector3d> before = bundle.points;
  ceres::Solver::Summary solved;
  ceres::Solve(solver, p.problem.get(), &solved);
  context.ThrowIfStopped();
  if (!solved.IsSolutionUsable()) {
    bundle.points = before;
    return {false, static_cast<int>(solved.iterations.size())};
  }
  for (std::size_t i = 0; i < bundle.images.size(); ++i) {
    const auto& pose = p.poses[i];
    bundle.images[i].rotation = Eigen::Quaterniond(pose[3], pose[0], pose[1], pose[2]);
    bundle.images[i].translation = {pose[4], pose[5], pose[6]};
  }
  return {solved.termination_type == ceres::CONVERGENCE, static_cast<int>(solved.iterations.size())};
}

}  // namespace rilievo::adjustment
