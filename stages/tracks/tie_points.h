// From the verified pairs of a block to the tie points that mapping gets.
#pragma once

#include <span>
#include <vector>

#include "base/run_context.h"
#include "block/tie_summary.h"
#include "block/track.h"
#include "stages/tracks/tracks.h"
#include "stages/tracks/triplets.h"

namespace rilievo::tracks {

struct TiePoints {
  std::vector<Track> tracks;  ///< sorted by elements
  TieSummary summary;
};

/// Triplets are those of an ordered sequence; none: all matches of all verified pairs are concatenated. Then, if the
/// options say so, the tie points are reduced. Deterministic; cost as Estimate says.
TiePoints MakeTiePoints(const SequenceInput& input, const Options& options, RunContext& context);

}  // namespace rilievo::tracks
