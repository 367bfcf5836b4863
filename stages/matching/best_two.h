// The two nearest of a stream of neighbours.
#pragma once

#include <algorithm>

#include "stages/matching/matching_kernels.h"

namespace rilievo::matching {

/// Takes one more neighbour into account; ties go to the lower index, so the order of the offers is free.
inline void Offer(BestTwo& best, std::int32_t distance_sq, std::uint32_t index) {
  if (distance_sq < best.first_sq || (distance_sq == best.first_sq && index < best.index)) {
    best = {.first_sq = distance_sq, .second_sq = best.first_sq, .index = index};
  } else {
    best.second_sq = std::min(best.second_sq, distance_sq);
  }
}

/// Takes the two nearest of a further set into account, whose members are not in the sets before.
inline void OfferBoth(BestTwo& best, const BestTwo& other) {
  if (other.first_sq == BestTwo::kNone) return;
  Offer(best, other.first_sq, other.index);
  best.second_sq = std::min(best.second_sq, other.second_sq);
}

}  // namespace rilievo::matching
