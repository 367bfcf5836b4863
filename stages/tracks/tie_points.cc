// Triplets, concatenation, reduction.
#include "stages/tracks/tie_points.h"

#include <utility>

#include "stages/tracks/reduction.h"

namespace rilievo::tracks {

TiePoints MakeTiePoints(const SequenceInput& input, const Options& options, RunContext& context) {
  TiePoints result;
  if (input.triplets.empty()) {
    result.tracks = Run(input.pairs, context);
  } else {
    const SequenceMatches matches = CheckTriplets(input, options, context);
    result.tracks = Run(matches.pairs, context);
    result.summary.triplets = matches.summary;
  }
  const TieInput ties{input.block, input.keypoints, input.pairs, result.tracks};
  if (options.reduce) {
    Reduction reduction = ReduceTracks(ties, options.reduction_cell_px);
    result.summary.found = reduction.before;
    result.summary.used = reduction.after;
    result.summary.is_reduced = 1;
    result.tracks = std::move(reduction.tracks);
  } else {
    const TieIndex index(ties, options.reduction_cell_px);
    result.summary.found = result.summary.used = index.Measure(std::vector<std::uint8_t>(index.Count(), 1));
  }
  return result;
}

}  // namespace rilievo::tracks
