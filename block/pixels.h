// Decoded pixels, wherever they came from.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "block/image.h"

namespace rilievo {

/// Row-major grey image of 8 or 16 bits a pixel (one of the two vectors is used), with an optional 8-bit RGB copy.
struct GreyImage {
  int width_px = 0, height_px = 0;
  std::vector<std::uint8_t> u8;
  std::vector<std::uint16_t> u16;
  std::vector<std::uint8_t> rgb;  ///< empty, or 3 * width * height
  bool Is16Bit() const { return !u16.empty(); }
};

/// The pixels of images by name: files on disk, or a scene that renders them on demand.
class PixelSource {
 public:
  virtual ~PixelSource() = default;
  /// Whole image as stored (no EXIF rotation). Throws Error naming the image when it cannot be decoded.
  virtual GreyImage Load(const std::string& image_name, bool with_color) const = 0;
  /// Upper bound of the bytes that Load holds at once for this image, its result included.
  virtual std::uint64_t LoadPeakBytes(const Image& image, bool with_color) const = 0;
};

}  // namespace rilievo
