// Bundle adjustments of a growing model: which images and points take part, and what becomes of the others.
#pragma once

#include <cstdint>
#include <set>
#include <span>
#include <vector>

#include "base/run_context.h"
#include "block/block.h"
#include "stages/adjustment/adjustment.h"
#include "stages/mapping/reconstruction.h"

namespace rilievo::mapping {

/// Points that carry an adjustment of the given images: over a grid of about `cells` cells in every image the point
/// of most rays in each cell (SPEC 3), kept in all its images. Ascending tracks.
std::vector<std::uint32_t> CarryingTracks(const Block& block, const Reconstruction& model,
                                          std::span<const ImageId> images, int cells);

/// The named points with their rays in use, and the images that see them, as a model.
Model ToModel(const Reconstruction& reconstruction, std::span<const std::uint32_t> tracks);

/// Adjusts the named points and the images that see them, all but `options.fixed_images`, and takes the result over.
adjustment::Summary Adjust(const Block& block, Reconstruction& reconstruction, std::span<const std::uint32_t> tracks,
                           const adjustment::Options& options, RunContext& context);

/// Adjusts `image` and the registered images that share most points with it; the others stay. Then refines the points
/// they see.
void AdjustLocally(const Block& block, Reconstruction& reconstruction, ImageId image, double loss_scale_px,
                   RunContext& context);

struct GlobalAdjustment {
  int cells = 400;  ///< see CarryingTracks
  double loss_scale_px = 1;
  double function_tolerance = 1e-4;
};

/// Adjusts all images on carrying points with Cauchy's loss, and refines all points.
void AdjustGlobally(const Block& block, Reconstruction& reconstruction, const GlobalAdjustment& how,
                    RunContext& context);

}  // namespace rilievo::mapping
