// Which image pairs to match, and how the pair matrix is cut into tiles.
#pragma once

#include <cstddef>
#include <vector>

#include "block/pair.h"

namespace rilievo::scheduling {

/// A sparse block matches all n(n-1)/2 pairs; an ordered sequence the 2n-3 pairs of its n-2 overlapping triplets.
enum class Network { kSparse, kSequence };

/// Pairs (first < second), sorted. Images are numbered in block order. A closed sequence adds the pairs of the two
/// triplets across its end. O(result).
std::vector<ImagePair> SelectPairs(std::size_t image_count, Network network, bool closed_sequence = false);

/// A tile of the pair matrix: the pairs of one block of rows with one block of columns. Its images' features are loaded
/// once, and its results share one artifact.
struct PairTile {
  std::vector<ImageId> images;   ///< sorted; every image of `pairs`
  std::vector<ImagePair> pairs;  ///< sorted
};

/// Images a side of a tile: a fixed rule on the number of images (small blocks: fine tiles balance two cores; large
/// ones: fewer files and each descriptor block loaded less often). Never a function of memory or threads.
std::size_t TileEdge(std::size_t image_count);

/// Cuts `pairs` (sorted) into tiles ordered by their last image, then by their first: a tile can start as early as
/// possible.
std::vector<PairTile> TilePairs(const std::vector<ImagePair>& pairs, std::size_t tile_edge);

}  // namespace rilievo::scheduling
