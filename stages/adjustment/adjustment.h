// Bundle block adjustment of a model by collinearity.
#pragma once

#include <Eigen/Core>
#include <map>
#include <set>
#include <string>

#include "base/run_context.h"
#include "base/task_cost.h"
#include "block/block.h"
#include "block/model.h"
#include "stages/adjustment/loss.h"

namespace rilievo::adjustment {

inline constexpr int kVersion = 2;

/// The reduced system of this stage up to 500 images, Ceres' sparse one beyond; or one of the two.
enum class Method { kByCount, kReduced, kCeres };

struct Options {
  Loss loss = Loss::kLeastSquares;
  double loss_scale_px = 1.0;
  int max_iterations = 50;
  double function_tolerance = 1e-6;
  std::set<ImageId> fixed_images;  ///< exterior orientation held (local adjustments)
  bool fix_points = false;
  bool fix_gauge = true;  ///< first image fixed, and the largest baseline component to the farthest image
  Method method = Method::kByCount;
};

struct Summary {
  bool converged = false;
  int iterations = 0;
  double initial_cost = 0, final_cost = 0;  ///< 1/2 v'v in px^2
  double sigma0_px = 0;                     ///< sqrt(v'v / redundancy)
  long observations = 0, unknowns = 0, redundancy = 0;
};

TaskCost Estimate(std::size_t images, std::size_t points, std::size_t observations);

/// Adjusts `model` in place, calibration fixed, and fills the residuals of its observations. Bit-reproducible for any
/// number of threads. Throws Cancelled on a stop request.
Summary Run(const Block& block, Model& model, const Options& options, RunContext& context);

}  // namespace rilievo::adjustment
