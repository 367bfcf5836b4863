// Which pairs a model may start from, best first.
#pragma once

#include <span>
#include <vector>

#include "base/ids.h"
#include "block/pair.h"
#include "geometry/rigid3.h"
#include "stages/mapping/mapping.h"

namespace rilievo::mapping {

struct SeedPair {
  ImagePair pair;
  Rigid3 second_from_first;
  double score = 0;  ///< inliers * min(1, median angle / 15 deg)
  int tier = 0;      ///< 0 is best; see SeedPairs
};

/// Pairs that could start a model, by tier, then score, then image ids. Tiers are wide angles of general scenes (median
/// >= 5, 3, 1.5, 0.5 deg), then the same of planar ones (kHomography with a translation; the five-point solution holds
/// for planes), then of kFundamental ones, whose relative orientation is taken from F with the cameras' approximate
/// calibration. Pairs without translation never start a model: their points have no depth.
std::vector<SeedPair> SeedPairs(const Input& input, std::span<const TwoViewGeometry> pairs);

inline constexpr int kTiersOfAKind = 4;

}  // namespace rilievo::mapping
