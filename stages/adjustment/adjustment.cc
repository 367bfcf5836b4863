// The bundle block adjustment: builds Ceres' problem, solves it, counts and fills residuals.
#include "stages/adjustment/adjustment.h"

#include <ceres/ceres.h>
#include <glog/logging.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "base/check.h"
#include "stages/adjustment/reprojection.h"

namespace rilievo::adjustment {
namespace {

/// Up to here the reduced system of 6 unknowns an image is solved dense: 72 MB and 9 GFLOP at most. The sparse way has
/// to work out its structure first, which costs the square of a track's length a point: with long tracks far more than
/// that.
constexpr std::size_t kMostImagesDense = 500;

using PoseArray = std::array<double, kPoseSize>;

/// All unknowns side by side, poses by image and points in order: Ceres orders the elimination by address, and so the
/// order of every sum is fixed by the model alone.
struct Unknowns {
  std::vector<ImageId> images;  // ascending
  std::vector<PoseArray> poses;
  std::vector<Eigen::Vector3d> points;

  double* PoseOf(ImageId id) {
    const auto at = std::lower_bound(images.begin(), images.end(), id);
    return at != images.end() && *at == id ? poses[static_cast<std::size_t>(at - images.begin())].data() : nullptr;
  }
};

Unknowns Gather(const Model& model) {
  Unknowns unknowns;
  for (const auto& [id, pose] : model.cam_from_world) {
    unknowns.images.push_back(id);
    const auto& q = pose.rotation;
    const auto& t = pose.translation;
    unknowns.poses.push_back({q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z()});
  }
  unknowns.points.reserve(model.points.size());
  for (const Point& point : model.points) unknowns.points.push_back(point.position);
  return unknowns;
}

void Scatter(const Unknowns& unknowns, Model& model) {
  std::size_t i = 0;
  for (auto& [id, pose] : model.cam_from_world) {
    const PoseArray& p = unknowns.poses[i++];
    pose = Rigid3(Eigen::Quaterniond(p[3], p[0], p[1], p[2]), Eigen::Vector3d(p[4], p[5], p[6]));
  }
  for (std::size_t j = 0; j < model.points.size(); ++j) model.points[j].position = unknowns.points[j];
}

/// 1/2 v'v over all observations that project, whose residuals are filled; others get infinite ones.
double FillResiduals(const Block& block, Model& model) {
  double sum = 0;
  for (Point& point : model.points) {
    for (Observation& o : point.observations) {
      const auto pose = model.cam_from_world.find(o.feature.image);
      if (pose == model.cam_from_world.end()) continue;
      const auto projected = block.camera_of(o.feature.image).model.Project(pose->second * point.position);
      o.residual_px = projected ? Eigen::Vector2d(*projected - o.measured_px)
                                : Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
      if (projected) sum += o.residual_px.squaredNorm();
    }
  }
  return 0.5 * sum;
}

class StopCallback final : public ceres::IterationCallback {
 public:
  explicit StopCallback(const RunContext& context) : context_(context) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary&) override {
    return context_.StopRequested() ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
  }

 private:
  const RunContext& context_;
};

/// Which images the datum holds when nothing else does: the first image wholly, and of the image farthest from it the
/// translation's component that a change of scale moves most.
struct Datum {
  ImageId fixed, scaled;
  int held_increment = -1;
};

Datum ChooseDatum(const Model& model, ImageId fixed) {
  Datum datum{fixed, {}, -1};
  const Eigen::Vector3d center = model.cam_from_world.at(fixed).Center();
  double farthest = 0;
  for (const auto& [id, pose] : model.cam_from_world) {
    const double distance = (pose.Center() - center).norm();
    if (distance > farthest) farthest = distance, datum.scaled = id;
  }
  if (!datum.scaled.IsValid()) return datum;
  const Rigid3& pose = model.cam_from_world.at(datum.scaled);
  Eigen::Index component = 0;
  (pose.rotation * (pose.Center() - center)).cwiseAbs().maxCoeff(&component);
  datum.held_increment = 3 + static_cast<int>(component);
  return datum;
}

std::unique_ptr<ceres::LossFunction> MakeLoss(const Options& options) {
  if (options.loss == Loss::kHuber) return std::make_unique<ceres::HuberLoss>(options.loss_scale_px);
  if (options.loss == Loss::kCauchy) return std::make_unique<ceres::CauchyLoss>(options.loss_scale_px);
  return nullptr;
}

/// Ceres' problem with the objects it refers to; costs lie side by side and live as long as the problem.
struct Problem {
  std::deque<Reprojection> costs;
  std::unique_ptr<ceres::LossFunction> loss;
  PoseManifold free_pose;
  std::optional<PoseManifold> scaled_pose;
  std::vector<std::uint8_t> image_used, point_used;  // by position in Unknowns
  std::unique_ptr<ceres::Problem> ceres;
};

Problem MakeProblem(const Block& block, const Model& model, const Options& options, Unknowns& unknowns) {
  Problem problem;
  problem.loss = MakeLoss(options);
  problem.image_used.assign(unknowns.images.size(), 0);
  problem.point_used.assign(unknowns.points.size(), 0);
  ceres::Problem::Options ceres_options;
  ceres_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres_options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres_options.disable_all_safety_checks = true;
  problem.ceres = std::make_unique<ceres::Problem>(ceres_options);
  for (std::size_t j = 0; j < model.points.size(); ++j) {
    for (const Observation& o : model.points[j].observations) {
      double* pose = unknowns.PoseOf(o.feature.image);
      if (pose == nullptr || !o.residual_px.allFinite()) continue;  // not in the model, or behind its camera
      const auto i = static_cast<std::size_t>((pose - unknowns.poses[0].data()) / kPoseSize);
      const auto& cost = problem.costs.emplace_back(block.camera_of(o.feature.image).model, o.measured_px);
      problem.ceres->AddResidualBlock(const_cast<Reprojection*>(&cost), problem.loss.get(), pose,
                                      unknowns.points[j].data());
      problem.image_used[i] = problem.point_used[j] = 1;
    }
  }
  return problem;
}

/// Holds what is fixed. Returns the number of unknowns and the datum defect that remains to be counted.
std::pair<long, long> Constrain(const Model& model, const Options& options, Unknowns& unknowns, Problem& problem) {
  long free_images = 0, fixed_images = 0, points = 0;
  ImageId first, first_fixed;
  for (std::size_t i = 0; i < unknowns.images.size(); ++i) {
    if (!problem.image_used[i]) continue;
    double* pose = unknowns.poses[i].data();
    if (!first.IsValid()) first = unknowns.images[i];
    problem.ceres->SetManifold(pose, &problem.free_pose);
    if (options.fixed_images.contains(unknowns.images[i])) {
      problem.ceres->SetParameterBlockConstant(pose);
      if (!first_fixed.IsValid()) first_fixed = unknowns.images[i];
      ++fixed_images;
    } else {
      ++free_images;
    }
  }
  for (std::size_t j = 0; j < unknowns.points.size(); ++j) {
    if (!problem.point_used[j]) continue;
    ++points;
    if (options.fix_points) problem.ceres->SetParameterBlockConstant(unknowns.points[j].data());
  }
  if (options.fix_points) return {6 * free_images, 0};
  const long defect = fixed_images == 0 ? 7 : fixed_images == 1 ? 1 : 0;
  if (options.fix_gauge && defect > 0 && first.IsValid()) {
    const Datum datum = ChooseDatum(model, first_fixed.IsValid() ? first_fixed : first);
    problem.ceres->SetParameterBlockConstant(unknowns.PoseOf(datum.fixed));
    if (datum.scaled.IsValid()) {
      const auto at =
          std::lower_bound(unknowns.images.begin(), unknowns.images.end(), datum.scaled) - unknowns.images.begin();
      if (problem.image_used[static_cast<std::size_t>(at)]) {
        problem.scaled_pose.emplace(datum.held_increment);
        problem.ceres->SetManifold(unknowns.PoseOf(datum.scaled), &*problem.scaled_pose);
      }
    }
  }
  return {6 * free_images + 3 * points, defect};
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

ceres::Solver::Summary Solve(const Options& options, Unknowns& unknowns, Problem& problem, RunContext& context) {
  ceres::Solver::Options solver;
  // Eigen's solvers only: a BLAS may use threads and picks its kernels by processor, and both change the last bits.
  solver.linear_solver_type = unknowns.images.size() <= kMostImagesDense ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
  solver.dense_linear_algebra_library_type = ceres::EIGEN;
  solver.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  solver.num_threads = 1;  // threaded sums depend on the order of arrival
  solver.max_num_iterations = options.max_iterations;
  solver.function_tolerance = options.function_tolerance;
  solver.gradient_tolerance = 1e-12;
  solver.parameter_tolerance = 1e-12;
  solver.logging_type = ceres::SILENT;
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (std::size_t j = 0; j < unknowns.points.size(); ++j)
    if (problem.point_used[j]) ordering->AddElementToGroup(unknowns.points[j].data(), 0);
  for (std::size_t i = 0; i < unknowns.images.size(); ++i)
    if (problem.image_used[i]) ordering->AddElementToGroup(unknowns.poses[i].data(), 1);
  solver.linear_solver_ordering = ordering;
  StopCallback stop(context);
  solver.callbacks.push_back(&stop);
  SilenceLibraryLog();
  ceres::Solver::Summary summary;
  ceres::Solve(solver, problem.ceres.get(), &summary);
  return summary;
}

}  // namespace

TaskCost Estimate(std::size_t images, std::size_t points, std::size_t observations) {
  // Measured with Ceres 2.1: 640 bytes an observation at 414,000 observations of 16,000 points; points of two rays
  // bring 400 bytes each on top. The reduced system and its factor are dense up to kMostImagesDense; beyond, the
  // structure of the sparse one holds an entry of 24 bytes for every pair of images of every point, reckoned here with
  // tracks of up to 32 images.
  TaskCost cost;
  cost.peak_bytes = 16 * 1024 * 1024 + 680 * observations + 400 * points;
  cost.peak_bytes +=
      images <= kMostImagesDense ? 2 * 36 * 8 * images * images : 2 * 36 * 8 * 64 * images + 24 * 32 * observations;
  cost.work = 2e-5 * static_cast<double>(observations) + 1e-6 * static_cast<double>(images * images);
  return cost;
}

Summary Run(const Block& block, Model& model, const Options& options, RunContext& context) {
  context.ThrowIfStopped();
  Summary summary;
  summary.initial_cost = summary.final_cost = FillResiduals(block, model);
  Unknowns unknowns = Gather(model);
  Problem problem = MakeProblem(block, model, options, unknowns);
  summary.observations = 2 * static_cast<long>(problem.costs.size());
  model.sigma0_px = 0;
  model.redundancy = 0;
  if (problem.costs.empty()) return summary;
  const auto [count, defect] = Constrain(model, options, unknowns, problem);
  summary.unknowns = count;
  summary.redundancy = summary.observations - count + defect;
  const ceres::Solver::Summary solved = Solve(options, unknowns, problem, context);
  context.ThrowIfStopped();
  summary.converged = solved.termination_type == ceres::CONVERGENCE;
  summary.iterations = static_cast<int>(solved.iterations.size());
  if (solved.IsSolutionUsable()) Scatter(unknowns, model);
  summary.final_cost = FillResiduals(block, model);
  if (summary.redundancy > 0)
    summary.sigma0_px = std::sqrt(2 * summary.final_cost / static_cast<double>(summary.redundancy));
  model.sigma0_px = summary.sigma0_px;
  model.redundancy = std::max(0L, summary.redundancy);
  return summary;
}

}  // namespace rilievo::adjustment
