// Decodes TIFF by rows, strips or tiles with libtiff.
#pragma once

#include <filesystem>

#include "block/pixels.h"

namespace rilievo::images {

/// The first image of a TIFF of 8 or 16 bits: grey (black or white is zero), RGB, palette, YCbCr; strips or tiles,
/// samples together or in planes, either byte order, every compression libtiff knows. The Orientation tag is ignored,
/// further samples (transparency) are dropped. Throws Error for a file that is truncated or damaged. Memory beside the
/// result: FormatHeader::decode_scratch_bytes (block/io/image_format.h).
GreyImage DecodeTiff(const std::filesystem::path& path, bool with_color);

}  // namespace rilievo::images
