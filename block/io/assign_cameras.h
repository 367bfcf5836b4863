// Makes a block: gives every image its camera, from a calibration or from EXIF.
#pragma once

#include <string>
#include <vector>

#include "block/block.h"
#include "block/io/calibration.h"

namespace rilievo::io {

struct BlockWithWarnings {
  Block block;
  std::vector<std::string> warnings;  ///< one line each, for the user to see
};

/// Images keep their order and get ids. With calibrations each image takes the entry of its folder (the deepest that
/// names one), of its size, or the one without a size. Throws Error naming image and sizes when none fits, when several
/// fit equally, or when an entry without a size cannot belong to the image: principal point farther than a fifth of the
/// size from the centre, images of several sizes. Nothing is ever rotated or scaled to fit. Without calibrations the
/// focal length comes from EXIF, or is guessed as 1.2 times the longer side, the principal point is the centre, and a
/// warning says so. Images of equal calibration and size (or equal size, EXIF camera, lens and focal length) share a
/// camera.
BlockWithWarnings MakeBlock(std::vector<Image> images, std::vector<QuarantinedImage> quarantined,
                            std::vector<CalibrationEntry> entries);

}  // namespace rilievo::io
