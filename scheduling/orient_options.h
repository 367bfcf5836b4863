// The options of an orientation run, one group a stage.
#pragma once

#include <vector>

#include "block/pair.h"
#include "scheduling/pair_options.h"
#include "scheduling/pair_selection.h"
#include "stages/features/features.h"
#include "stages/mapping/mapping.h"
#include "stages/matching/matching.h"
#include "stages/tracks/tracks.h"
#include "stages/verification/verification.h"

namespace rilievo::scheduling {

struct OrientOptions {
  Network network = Network::kSparse;
  PairOptions pairs;
  std::vector<ImagePair> listed;  ///< sorted: the pairs of a spatial or listed block
  features::Options features;
  matching::Options matching;
  verification::Options verification;
  tracks::Options tracks;
  mapping::Options mapping;
};

/// Throws Error(kUsage) naming the first option out of range.
void Validate(const OrientOptions& options);

}  // namespace rilievo::scheduling
