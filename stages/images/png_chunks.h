// Checks a PNG's chunks and keeps those that make pixels.
#pragma once

#include <string>
#include <string_view>

namespace rilievo::images {

/// Verifies lengths and checksums of all chunks up to IEND and leaves IHDR, PLTE, IDAT and IEND in `png`: damage is
/// found before a decoder meets it, and profiles, texts and transparency never reach it. Returns "" or what is wrong.
std::string KeepPixelChunks(std::string& png);

}  // namespace rilievo::images
