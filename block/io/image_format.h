// The containers JPEG, PNG and TIFF as far as their headers go: size, samples and where the EXIF block lies.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <vector>

namespace rilievo::io {

enum class ImageFormat { kJpeg, kPng, kTiff };

struct FormatHeader {
  ImageFormat format = ImageFormat::kJpeg;
  long long width_px = 0, height_px = 0;
  int channels = 0, bits_per_sample = 0;  ///< as decoded: palettes count as 3 channels, fewer than 8 bits of PNG as 8
  std::vector<std::uint8_t> exif;         ///< TIFF-structured EXIF block of a JPEG; empty for other formats
  /// Upper bound of what decoding it row by row (strip by strip, tile by tile) holds beside the pixels it gives.
  std::uint64_t decode_scratch_bytes = 0;
};

/// Largest image that is accepted, in pixels.
inline constexpr long long kMaxImagePixels = 500'000'000;

/// Reads the header of an image file. Throws Error naming `path`, also for an implausible size, a TIFF whose strips or
/// tiles end outside the file, and a file that is shorter than its format can make an image of that size: memory is
/// planned by the header, so a few broken bytes must not ask for gigabytes.
FormatHeader ReadFormatHeader(const std::filesystem::path& path);

}  // namespace rilievo::io
