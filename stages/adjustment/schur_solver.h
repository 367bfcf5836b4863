// Least squares over poses and points by Levenberg-Marquardt on the reduced system of the poses.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "base/run_context.h"
#include "geometry/camera_model.h"
#include "stages/adjustment/loss.h"

namespace rilievo::adjustment {

/// A pose, cam_from_world. Increments: rotation vector w (R' = exp(w) R), then the translation's.
struct BundleImage {
  const CameraModel* camera = nullptr;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  bool is_fixed = false;
  int held = -1;  ///< increment (0..5) that stays zero, or none
};

struct BundleRay {
  std::uint32_t image = 0;
  Eigen::Vector2d measured_px = Eigen::Vector2d::Zero();
};

struct BundleProblem {
  std::vector<BundleImage> images;
  std::vector<Eigen::Vector3d> points;
  std::vector<std::size_t> first_ray;  ///< by point, and the end
  std::vector<BundleRay> rays;
  bool fix_points = false;
};

struct BundleOptions {
  Loss loss = Loss::kLeastSquares;
  double loss_scale_px = 1;
  int max_iterations = 50;
  double function_tolerance = 1e-6;  ///< relative decrease of the cost at which a step is the last one
};

struct BundleSummary {
  bool converged = false;
  int iterations = 0;
};

/// Minimises 1/2 sum rho(|residual|^2) in place. Points are eliminated (their 3 x 3 blocks), the reduced system of six
/// unknowns a free image is solved dense, weights of the loss are those of the last linearisation. Sums run over a
/// number of parts fixed by the problem, merged in order: bit-identical for any number of threads. Holds 200 bytes a
/// ray, 130 a point and, a part, 288 bytes for the square of the number of free images. Throws Cancelled.
BundleSummary SolveBundle(BundleProblem& problem, const BundleOptions& options, RunContext& context);

/// Upper bound of the bytes that SolveBundle holds beside the problem.
std::size_t SolveBundleBytes(std::size_t images, std::size_t points, std::size_t rays);

}  // namespace rilievo::adjustment
