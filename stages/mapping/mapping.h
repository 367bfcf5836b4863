// Incremental mapping: from verified pairs and tracks to oriented models with object points.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "base/checkpoints.h"
#include "base/option.h"
#include "base/run_context.h"
#include "base/task_cost.h"
#include "block/block.h"
#include "block/features.h"
#include "block/model.h"
#include "block/pair.h"
#include "block/track.h"

namespace rilievo::mapping {

struct Options {
  double max_residual_px = 4.0;  ///< resection and triangulation threshold, at full resolution
  double min_angle_deg = 1.5;    ///< least intersection angle of an object point
  int min_resection_inliers = 12;
  int min_model_images = 2;
};

std::span<const OptionDeclaration<Options>> OptionDeclarations();
inline constexpr int kVersion = 2;

TaskCost Estimate(std::size_t images, std::size_t features_in_all, std::size_t matches_in_all);

struct Input {
  const Block& block;
  std::span<const std::vector<Keypoint>> keypoints;  ///< by image id
  std::span<const std::vector<Rgb>> colors;          ///< by image id
  std::span<const TwoViewGeometry> pairs;            ///< verified and rejected, sorted by pair
  std::span<const Track> tracks;
};

struct Output {
  std::vector<Model> models;                ///< largest first; disconnected scenes give several
  std::vector<UnorientedImage> unoriented;  ///< images in no model, with the reason
  std::vector<std::string> warnings;        ///< what speaks against the models, one line each (see Doubts)
  std::size_t images_taken_over = 0;        ///< mapped by an earlier run, whose checkpoint this one went on from
};

/// Deterministic: seeds come from context.Seed() and image ids. Throws Cancelled on a stop request. Goes on from the
/// last checkpoint, and keeps one after each global adjustment; the result is the same, but for `images_taken_over`.
Output Run(const Input& input, const Options& options, Checkpoints& checkpoints, RunContext& context);
/// The same without checkpoints.
Output Run(const Input& input, const Options& options, RunContext& context);

}  // namespace rilievo::mapping
