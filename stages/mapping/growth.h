// Grows one model from a seed pair: next image, resection, new points, adjustments.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "base/run_context.h"
#include "block/block.h"
#include "stages/mapping/mapper_state.h"
#include "stages/mapping/mapping.h"
#include "stages/mapping/reconstruction.h"
#include "stages/mapping/seeds.h"

namespace rilievo::mapping {

struct GrowthInput {
  const Block& block;
  const TieBlock& ties;
  const Options& options;
  const std::vector<std::uint8_t>& available;  ///< per image: 1 = may join this model
};

PointTolerance ToleranceOf(const Options& options);

/// Two images from their relative orientation, adjusted. None when fewer than max(15, min_resection_inliers) points
/// remain.
std::optional<Reconstruction> StartFromPair(const GrowthInput& input, const SeedPair& seed, RunContext& context);

/// Adds images until none can be added: strict resections first (30 inliers, a quarter of the visible points), then
/// relaxed ones (options.min_resection_inliers, a tenth). Phases: strict, then three rounds of settling, relaxed and
/// strict. Goes on from where `state` stands; calls `keep` after global adjustments, when `state` is whole.
void Grow(const GrowthInput& input, GrowthState& state, const std::function<void()>& keep, RunContext& context);

/// Adjust, filter, triangulate again, until few rays change (at most `rounds` times); drops images left with too few
/// rays.
void Settle(const GrowthInput& input, Reconstruction& model, int rounds, RunContext& context);

/// Coverage of an image by points in it: over grids of 2, 4, ... 32 cells a side, occupied cells weighted by 2^level.
std::int64_t CoverageScore(const Camera& camera, std::span<const Eigen::Vector2d> positions_px);

}  // namespace rilievo::mapping
