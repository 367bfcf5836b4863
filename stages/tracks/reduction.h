// Tie point reduction: the points of most rays, spread over a grid on every image.
#pragma once

#include <vector>

#include "block/tie_summary.h"
#include "block/track.h"
#include "stages/tracks/tie_index.h"

namespace rilievo::tracks {

struct Reduction {
  std::vector<Track> tracks;  ///< in all their images; sorted by elements
  TieSetSummary before, after;
};

/// SPEC 3. Of every cell of every image the track of most rays is kept (then smaller mean sigma of detection, then
/// elements): walking from the best track down, one is kept when it is the best of a cell that is not filled yet, and
/// fills its cells in all its images. Cells that held a ray still hold one. Then, best tracks first, pairs of images
/// get back what they lack to kCommonPoints common ones (or to what they had): the strong pairs, and each image's
/// kLinksPerImage verified pairs of most matches. Does not depend on the order of tracks or pairs.
/// O(rays log tracks + tracks of both images of every verified pair).
Reduction ReduceTracks(const TieInput& input, double cell_px);

}  // namespace rilievo::tracks
