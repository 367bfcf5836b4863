// The bundle block adjustment of a model: gathers the rays, holds the datum, solves, counts and fills residuals.
#include "stages/adjustment/adjustment.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "stages/adjustment/ceres_solver.h"
#include "stages/adjustment/schur_solver.h"

namespace rilievo::adjustment {
namespace {

/// Up to here the reduced system of 6 unknowns an image is solved dense: 72 MB and 9 GFLOP at most. The sparse way has
/// to work out its structure first, which costs the square of a track's length a point: with long tracks far more than
/// that.
constexpr std::size_t kMostImagesDense = 500;

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

/// The rays of a model in the order of its points. Images without rays are held: nothing determines them.
struct Gathered {
  BundleProblem bundle;
  std::vector<ImageId> images;  ///< by place in the bundle; ascending
  std::vector<std::uint8_t> image_used;
};

Gathered Gather(const Block& block, const Model& model, const Options& options) {
  Gathered g;
  g.bundle.fix_points = options.fix_points;
  std::vector<std::int64_t> place;  // by image id
  for (const auto& [id, pose] : model.cam_from_world) {
    place.resize(id.value + std::size_t{1}, -1);
    place[id.value] = static_cast<std::int64_t>(g.images.size());
    g.images.push_back(id);
    g.bundle.images.push_back(
        {&block.camera_of(id).model, pose.rotation, pose.translation, options.fixed_images.contains(id), -1});
  }
  g.image_used.assign(g.images.size(), 0);
  g.bundle.points.reserve(model.points.size());
  g.bundle.first_ray.reserve(model.points.size() + 1);
  for (const Point& point : model.points) {
    g.bundle.points.push_back(point.position);
    g.bundle.first_ray.push_back(g.bundle.rays.size());
    for (const Observation& o : point.observations) {
      const std::size_t id = o.feature.image.value;
      if (id >= place.size() || place[id] < 0 || !o.residual_px.allFinite()) continue;  // elsewhere, or behind
      g.bundle.rays.push_back({static_cast<std::uint32_t>(place[id]), o.measured_px});
      g.image_used[static_cast<std::size_t>(place[id])] = 1;
    }
  }
  g.bundle.first_ray.push_back(g.bundle.rays.size());
  return g;
}

struct Count {
  long unknowns = 0, defect = 0;
};

/// Holds what is fixed. Counts the unknowns, and the datum defect that remains to be counted.
Count Constrain(const Model& model, const Options& options, Gathered& g) {
  long free_images = 0, fixed_images = 0, points = 0;
  ImageId first, first_fixed;
  for (std::size_t i = 0; i < g.images.size(); ++i) {
    if (!g.image_used[i]) {
      g.bundle.images[i].is_fixed = true;
      continue;
    }
    if (!first.IsValid()) first = g.images[i];
    if (g.bundle.images[i].is_fixed && !first_fixed.IsValid()) first_fixed = g.images[i];
    ++(g.bundle.images[i].is_fixed ? fixed_images : free_images);
  }
  for (std::size_t j = 0; j < g.bundle.points.size(); ++j) points += g.bundle.first_ray[j] < g.bundle.first_ray[j + 1];
  if (options.fix_points) return {6 * free_images, 0};
  const long defect = fixed_images == 0 ? 7 : fixed_images == 1 ? 1 : 0;
  if (options.fix_gauge && defect > 0 && first.IsValid()) {
    const Datum datum = ChooseDatum(model, first_fixed.IsValid() ? first_fixed : first);
    const auto image = [&](ImageId id) -> BundleImage& {
      return g.bundle
          .images[static_cast<std::size_t>(std::lower_bound(g.images.begin(), g.images.end(), id) - g.images.begin())];
    };
    image(datum.fixed).is_fixed = true;
    if (datum.scaled.IsValid()) image(datum.scaled).held = datum.held_increment;
  }
  return {6 * free_images + 3 * points, defect};
}

void Scatter(const Gathered& g, Model& model) {
  std::size_t i = 0;
  for (auto& [id, pose] : model.cam_from_world) {
    const BundleImage& image = g.bundle.images[i++];
    pose = Rigid3(image.rotation, image.translation);
  }
  for (std::size_t j = 0; j < model.points.size(); ++j) model.points[j].position = g.bundle.points[j];
}

BundleSummary Solve(Gathered& g, const Options& options, RunContext& context) {
  const BundleOptions how{options.loss, options.loss_scale_px, options.max_iterations, options.function_tolerance};
  const bool own =
      options.method == Method::kReduced || (options.method == Method::kByCount && g.images.size() <= kMostImagesDense);
  return own ? SolveBundle(g.bundle, how, context) : SolveWithCeres(g.bundle, how, kMostImagesDense, context);
}

}  // namespace

TaskCost Estimate(std::size_t images, std::size_t points, std::size_t observations) {
  TaskCost cost;
  const std::uint64_t gathered = 32 * observations + 40 * points + 400 * images;
  if (images <= kMostImagesDense) {
    cost.peak_bytes = (std::uint64_t{16} << 20) + gathered + SolveBundleBytes(images, points, observations);
    cost.work = 6e-6 * static_cast<double>(observations) + 1e-6 * static_cast<double>(images * images);
    return cost;
  }
  // Measured with Ceres 2.1: 640 bytes an observation at 414,000 observations of 16,000 points; points of two rays
  // bring 400 bytes each on top. The structure of the sparse reduced system holds an entry of 24 bytes for every pair
  // of images of every point, reckoned here with tracks of up to 32 images.
  cost.peak_bytes = (std::uint64_t{16} << 20) + gathered + 680 * observations + 400 * points +
                    2 * 36 * 8 * 64 * images + 24 * 32 * observations;
  cost.work = 2e-5 * static_cast<double>(observations) + 1e-6 * static_cast<double>(images * images);
  return cost;
}

Summary Run(const Block& block, Model& model, const Options& options, RunContext& context) {
  context.ThrowIfStopped();
  Summary summary;
  summary.initial_cost = summary.final_cost = FillResiduals(block, model);
  Gathered gathered = Gather(block, model, options);
  summary.observations = 2 * static_cast<long>(gathered.bundle.rays.size());
  model.sigma0_px = 0;
  model.redundancy = 0;
  if (gathered.bundle.rays.empty()) return summary;
  const Count count = Constrain(model, options, gathered);
  summary.unknowns = count.unknowns;
  summary.redundancy = summary.observations - count.unknowns + count.defect;
  const BundleSummary solved = Solve(gathered, options, context);
  context.ThrowIfStopped();
  summary.converged = solved.converged;
  summary.iterations = solved.iterations;
  Scatter(gathered, model);
  summary.final_cost = FillResiduals(block, model);
  if (summary.redundancy > 0)
    summary.sigma0_px = std::sqrt(2 * summary.final_cost / static_cast<double>(summary.redundancy));
  model.sigma0_px = summary.sigma0_px;
  model.redundancy = std::max(0L, summary.redundancy);
  return summary;
}

}  // namespace rilievo::adjustment
