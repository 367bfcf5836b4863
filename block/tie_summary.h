// What became of the matches on the way to tie points, for the report.
#pragma once

#include <cstdint>

namespace rilievo {

/// The triplets of an ordered sequence. All zero for other networks. Fields of eight bytes: stored as they are.
struct TripletSummary {
  std::uint64_t triplets = 0;
  std::uint64_t unchecked = 0;     ///< without a relative orientation that has a base: closed loops alone decide
  std::uint64_t weak = 0;          ///< too few points: loops that are open or fail are used too
  std::uint64_t poor_images = 0;   ///< too few points in all: all matches of their pairs are used
  std::uint64_t loops = 0;         ///< features of three images matched in all three pairs
  std::uint64_t failed_loops = 0;  ///< of these, those that the three-view check dropped
  std::uint64_t matches = 0;       ///< in verified pairs
  std::uint64_t matches_used = 0;  ///< of these, those that became tie points
};

/// A set of tie points and how it holds the block together. Two images are linked when they share ten tie points.
struct TieSetSummary {
  std::uint64_t points = 0, rays = 0;
  std::uint64_t cells = 0;         ///< cells of the reduction grid that hold a ray, all images together
  std::uint64_t linked_pairs = 0;  ///< of the verified pairs
  std::uint64_t least_common = 0;  ///< fewest common tie points of a strong pair (30 verified matches); 0 without any
  std::uint64_t least_links = 0;   ///< fewest links of an image that has tie points
  std::uint64_t groups = 0;        ///< groups of images that links hold together, images without links left out
};

struct TieSummary {
  TripletSummary triplets;
  TieSetSummary found, used;  ///< before and after the reduction; equal without one
  std::uint64_t is_reduced = 0;
};

}  // namespace rilievo
