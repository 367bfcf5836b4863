// Verification of a pair: essential (calibrated) or fundamental matrix by robust estimation, homography beside it.
#pragma once

#include <span>

#include "base/option.h"
#include "base/run_context.h"
#include "base/task_cost.h"
#include "block/camera.h"
#include "block/features.h"
#include "block/pair.h"

namespace rilievo::verification {

struct Options {
  std::string estimator = "mapsac";  ///< ransac, lmeds, mapsac
  double threshold_px = 2.0;         ///< Sampson distance at full resolution
  double confidence = 0.9999;
  int max_trials = 10000;
  int min_inliers = 15;
  double planar_ratio = 0.8;  ///< H inliers / E inliers above which the pair is planar or rotation only
};

std::span<const OptionDeclaration<Options>> OptionDeclarations();
inline constexpr int kVersion = 2;

TaskCost Estimate(std::size_t matches);

struct Input {
  ImagePair pair;
  const Camera& camera_first;
  const Camera& camera_second;
  std::span<const Keypoint> keypoints_first;
  std::span<const Keypoint> keypoints_second;
  std::span<const Match> matches;
};

/// Calibrated cameras: E by the five-point solver on undistorted rays, relative pose by cheirality, inliers by Sampson
/// distance. Cameras whose focal length is a guess (CalibrationSource::kGuessed) get F by the seven-point solver as
/// well and keep whichever model has more support. H always beside: its ratio is reported, and the pair is kHomography
/// when planar or rotation only. Seeds: SeedFor(context.Seed(), first, second). Never throws for bad geometry: the
/// reason is in the result.
TwoViewGeometry Run(const Input& input, const Options& options, RunContext& context);

}  // namespace rilievo::verification
