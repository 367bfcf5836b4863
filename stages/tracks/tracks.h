// Tie points: verified matches of all pairs concatenated into tracks.
#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "base/option.h"
#include "base/run_context.h"
#include "base/task_cost.h"
#include "block/pair.h"
#include "block/track.h"

namespace rilievo::tracks {

struct Options {
  bool closed_sequence = false;         ///< the last images of a sequence overlap the first
  double three_view_residual_px = 3.0;  ///< of the third image of a triplet, at full resolution
  bool reduce = false;
  double reduction_cell_px = 0;  ///< width of a cell, three quarters of it high; 0 = by the size of the image
};

std::span<const OptionDeclaration<Options>> OptionDeclarations();
inline constexpr int kVersion = 2;

/// Of Run, and of the triplets and the reduction around it. `features_in_all` bounds what many matches of the same
/// features can become, where it is known.
TaskCost Estimate(std::size_t matches_in_all, std::size_t features_in_all = std::numeric_limits<std::size_t>::max());

/// Union-find over (image, feature). Edges are taken in descending support (inliers of the pair, then pair and match
/// order); a merge that would put two features of one image into one track is refused (SPEC 2.2). Only tracks of >= 2
/// images are returned, sorted by first element: the result does not depend on the order of `pairs`.
std::vector<Track> Run(std::span<const TwoViewGeometry> pairs, RunContext& context);

}  // namespace rilievo::tracks
