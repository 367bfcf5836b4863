// The ratio test in integers.
#pragma once

#include <cstdint>

#include "stages/matching/matching_kernels.h"

namespace rilievo::matching {

/// d1 < ratio * d2 as d1^2 * 10^8 < round(ratio * 10^4)^2 * d2^2; both sides stay below 2^50. A neighbour without a
/// second one passes: nothing makes it ambiguous.
struct RatioTest {
  std::int64_t ratio_e4 = 8000;

  bool Passes(std::int32_t first_sq, std::int32_t second_sq) const {
    if (first_sq == BestTwo::kNone) return false;
    if (second_sq == BestTwo::kNone) return true;
    return std::int64_t{first_sq} * 100'000'000 < ratio_e4 * ratio_e4 * second_sq;
  }
  bool Passes(const BestTwo& best) const { return Passes(best.first_sq, best.second_sq); }
};

}  // namespace rilievo::matching
