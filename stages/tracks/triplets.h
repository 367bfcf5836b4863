// The ordered sequence: matches of overlapping triplets that close their loop and pass a three-view check.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "base/run_context.h"
#include "block/block.h"
#include "block/features.h"
#include "block/pair.h"
#include "block/tie_summary.h"
#include "stages/tracks/tracks.h"

namespace rilievo::tracks {

/// Three images in the order of the sequence.
using Triplet = std::array<ImageId, 3>;

/// The n - 2 triplets (i, i+1, i+2); a closed sequence of four or more images adds (n-2, n-1, 0) and (n-1, 0, 1).
std::vector<Triplet> SequenceTriplets(std::size_t image_count, bool closed);

/// Fewer points than this make a triplet weak, and an image poor (SPEC 2.2 item 3).
inline constexpr std::size_t kFewPoints = 20;

struct SequenceInput {
  const Block& block;
  std::span<const std::vector<Keypoint>> keypoints;  ///< by image id
  std::span<const TwoViewGeometry> pairs;            ///< sorted by pair; those of no triplet lose all their matches
  std::span<const Triplet> triplets;
};

struct SequenceMatches {
  std::vector<TwoViewGeometry> pairs;  ///< those of the input with the inliers that are used, sorted by first; features
                                       ///< at one position are replaced by the one that stands for it
  TripletSummary summary;
};

/// SPEC 2.1. A loop is a(f) - b(g) - c(h) with a - c matched as well. Check of three views: the pair of the widest
/// intersection angle gives the object points of the loops, the third image is resected on them (which fixes the scale
/// between the pairs) and must see each within `three_view_residual_px`. A loop that fails is
/// dropped; a match of it stays only where a neighbouring triplet confirms it. A weak triplet has no check to rely on:
/// all its features matched in a row a - b - c, loop closed or not, are used, for they carry the scale onwards. A poor
/// image gets all matches of its pairs, seen in two images only. Successive triplets grow into long tracks where
/// tracks::Run finds equal features. Linear in the number of triplets. Deterministic: seeds come from image ids.
SequenceMatches CheckTriplets(const SequenceInput& input, const Options& options, RunContext& context);

}  // namespace rilievo::tracks
