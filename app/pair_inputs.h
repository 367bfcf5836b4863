// Which pairs a run is asked for: block type, list file, GNSS positions.
#pragma once

#include <string>

#include "app/inputs.h"
#include "scheduling/orient_options.h"

namespace rilievo::app {

struct PairFlags {
  std::string network = "sparse";
  std::string list;  ///< file, empty = none
};

void AddPairFlags(CLI::App& command, PairFlags& flags);

/// The block type; throws Error(kUsage) when a list is given without `--network list`, or the other way round.
scheduling::Network NetworkOf(const PairFlags& flags);

/// Fills in `options.listed` for a spatial or listed block from its images; what was left out goes to the warnings of
/// `inputs`. Throws Error when that leaves no pair.
void ListPairs(const PairFlags& flags, Inputs& inputs, scheduling::OrientOptions& options);

}  // namespace rilievo::app
