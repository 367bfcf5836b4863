// The focal length in pixels as far as EXIF tells it.
#pragma once

#include <optional>
#include <string>

#include "block/image.h"

namespace rilievo::io {

struct ExifFocal {
  double focal_px = 0;
  std::string basis;  ///< "24 mm, 36.0 mm wide sensor": what it was computed from, for the warning
};

/// In order of trust: focal length and focal plane resolution (unless it contradicts the 35 mm equivalent: the image
/// was resized), focal length and the sensor width of a known camera, the 35 mm equivalent (CIPA DCG-001: by the
/// diagonal, 43.27 mm). None when EXIF does not suffice.
std::optional<ExifFocal> FocalFromExif(const ExifData& exif, int width_px, int height_px);

}  // namespace rilievo::io
