// How image pairs are chosen: the block type and the options of the types that have some.
#pragma once

#include <optional>
#include <span>
#include <string_view>

#include "base/option.h"

namespace rilievo::scheduling {

/// sparse: all n(n-1)/2 pairs; sequence: the 2n-3 pairs of n-2 overlapping triplets; guided: those that a fast pass on
/// few large features and the growth around verified pairs choose; spatial: neighbours by GNSS; list: those of a file.
enum class Network { kSparse, kSequence, kGuided, kSpatial, kList };

std::string_view NetworkName(Network network);
std::optional<Network> NetworkFromName(std::string_view name);

struct PairOptions {
  int neighbours = 20;
  double max_distance_m = 0;
  int guided_features = 768;
};

std::span<const OptionDeclaration<PairOptions>> PairOptionDeclarations();

}  // namespace rilievo::scheduling
