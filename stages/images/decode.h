// Decodes the photographs of a folder to grey (and RGB) pixels.
#pragma once

#include <filesystem>
#include <string>

#include "block/pixels.h"

namespace rilievo::images {

/// Files below `folder`, by name relative to it. JPEG, PNG and TIFF of 8 or 16 bits, grey or colour, pixels as stored;
/// alpha is dropped, CMYK is not read. Grey of a colour image is Y of ITU-R BT.601 and does not depend on `with_color`;
/// 16-bit images keep 16 bits in grey and give 8 bits in RGB. Load throws Error for a file that is truncated, corrupt
/// or of a kind that is not read, even where a library would give part of the pixels. Nothing is printed. May run in
/// several tasks at once. Memory: the result and Image::decode_scratch_bytes, so a few rows for most files.
class FolderPixelSource : public PixelSource {
 public:
  explicit FolderPixelSource(std::filesystem::path folder) : folder_(std::move(folder)) {}
  GreyImage Load(const std::string& image_name, bool with_color) const override;
  std::uint64_t LoadPeakBytes(const Image& image, bool with_color) const override;

 private:
  std::filesystem::path folder_;
};

}  // namespace rilievo::images
