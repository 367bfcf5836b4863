// Reads a list of image pairs from a text file.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "block/block.h"
#include "block/pair.h"

namespace rilievo::io {

/// `pairs`: sorted, each once. `left_out`: how many lines name an image that is there and cannot be used.
struct PairList {
  std::vector<ImagePair> pairs;
  std::size_t left_out = 0;
};

/// The pairs of a list file (docs/formats/pairs.md): two image names a line, in either order. A pair that is there
/// twice counts once. Throws Error with the line for a line that is not two names, unknown and ambiguous names and an
/// image paired with itself, and for a list without a usable pair. O(lines log images).
PairList ReadPairList(const std::filesystem::path& path, const Block& block);

}  // namespace rilievo::io
