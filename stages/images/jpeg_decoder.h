// Decodes JPEG row by row with libjpeg, and knows when pixels are missing or damaged.
#pragma once

#include <filesystem>

#include "block/pixels.h"

namespace rilievo::images {

/// Pixels of a baseline or progressive JPEG, 8 bit, grey, YCbCr or RGB; grey is the file's own Y where it has one.
/// libjpeg fills what a truncated file lacks with grey and only warns: here every warning that touches pixels is an
/// Error. Damage that happens to be valid code (a stretch of zero bytes) cannot be told from a picture. Memory beside
/// the result: a few rows; for progressive files and those of several scans 2 bytes a
/// sample of each component's own (subsampled) size. Cost about 4 ns a pixel, a quarter more
/// with colour.
GreyImage DecodeJpeg(const std::filesystem::path& path, bool with_color);

}  // namespace rilievo::images
