// Decodes PNG row by row with libpng.
#pragma once

#include <filesystem>

#include "block/pixels.h"

namespace rilievo::images {

/// Every PNG: 1 to 16 bits, grey, colour or palette, interlaced or not; transparency is dropped, nothing is corrected
/// for gamma. Throws Error for a file that is truncated or damaged anywhere up to its end. Memory beside the result: a
/// few rows.
GreyImage DecodePng(const std::filesystem::path& path, bool with_color);

}  // namespace rilievo::images
