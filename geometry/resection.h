// Space resection: the pose of a calibrated camera from object points and their rays.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "base/run_context.h"
#include "geometry/rigid3.h"

namespace rilievo {

/// points_in_world[i] is seen at normalized[i] = (X/Z, Y/Z); residuals are multiplied by focal_px.
struct ResectionInput {
  std::span<const Eigen::Vector3d> points_in_world;
  std::span<const Eigen::Vector2d> normalized;
  double focal_px = 1;
};

struct ResectionOptions {
  double max_residual_px = 4.0;
  double confidence = 0.9999;
  int max_trials = 5000;
  const RunContext* context = nullptr;  ///< polled for stop requests (throws Cancelled) when given
};

struct Resection {
  Rigid3 cam_from_world;
  std::vector<std::uint32_t> inliers;  ///< ascending
};

/// MAPSAC over P3P with local optimisation, then the collinearity resection with Cauchy weights of the inliers. None
/// for fewer than four points or when no sample gives a pose with four inliers. Depends on input, options and seed
/// only.
std::optional<Resection> EstimateResection(const ResectionInput& input, const ResectionOptions& options,
                                           std::uint64_t seed);

/// Collinearity resection of the named items (all are used, whatever their residuals) from a start: Levenberg-Marquardt
/// on the six increments, weights 1 / (1 + r^2 / loss_scale_px^2) (Cauchy) when loss_scale_px > 0. None when a point
/// lies behind the start or the equations are singular.
std::optional<Rigid3> RefineResection(const ResectionInput& input, std::span<const std::uint32_t> items,
                                      const Rigid3& start, double loss_scale_px, int max_iterations = 20);

}  // namespace rilievo
