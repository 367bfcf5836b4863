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
  std::vector<std::uint8_t> exif;         ///< TIFF-structured EXIF block of a JPEG or PNG; empty for TIFF, which is one
};

/// Reads the header of an image file. Throws Error naming `path`.
FormatHeader ReadFormatHeader(const std::filesystem::path& path);

}  // namespace rilievo::io
