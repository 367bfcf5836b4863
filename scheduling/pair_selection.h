// Which image pairs to match, and how the pair matrix is cut into tiles.
#pragma once

#include <cstddef>
#include <vector>

#include "block/pair.h"
#include "scheduling/pair_options.h"

namespace rilievo::scheduling {

/// Pairs (first < second), sorted, of the types that need the number of images alone: sparse and sequence; of others
/// none. Images are numbered in block order. A closed sequence adds the pairs of the two triplets across its end.
/// O(result).
std::vector<ImagePair> SelectPairs(std::size_t image_count, Network network, bool closed_sequence = false);

/// A tile of the pair matrix: the pairs of one block of rows (first image) with one block of columns (second image).
/// Its images' features are loaded once, and its results share one artifact.
struct PairTile {
  std::size_t row = 0, column = 0;  ///< blocks: image number / tile edge
  std::vector<ImageId> images;      ///< sorted; every image of `pairs`
  std::vector<ImagePair> pairs;     ///< sorted
};

/// Images a side of a tile: a fixed rule on the number of images, 2 up to 16, 4 up to 150, 8 beyond (small blocks: fine
/// tiles balance two cores; large ones: fewer files and each descriptor block loaded less often). Never a function of
/// memory or threads.
std::size_t TileEdge(std::size_t image_count);

/// Cuts `pairs` (sorted) into tiles ordered by column, then by row. The features of a block of columns stay resident
/// while its tiles run, each of which loads the features of its rows; and no tile waits for an image of a later column.
std::vector<PairTile> TilePairs(const std::vector<ImagePair>& pairs, std::size_t tile_edge);

}  // namespace rilievo::scheduling
