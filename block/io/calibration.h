// Reads camera calibrations (docs/formats/calibration.md).
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "geometry/camera_model.h"

namespace rilievo::io {

/// What pixel coordinate (0, 0) of a file means: the upper-left pixel's corner (its centre is (0.5, 0.5)) or its
/// centre.
enum class PixelOrigin { kCorner, kCenter };

struct CalibrationEntry {
  CameraModel model;                ///< pixel frame of this project (first pixel's centre (0.5, 0.5))
  int width_px = 0, height_px = 0;  ///< 0 = the file does not say: any size
  std::string folder;               ///< applies to the images of this subfolder only; empty: to all
  std::string label;                ///< where it came from, for reports
};

/// All cameras of a calibration file, the format told by content: 3x3 K as text, this project's TOML, OpenCV YAML or
/// XML, COLMAP cameras.txt. `text_origin` is the pixel origin of text K and cameras.txt; OpenCV means the centre, TOML
/// the corner, always. Throws Error with path, line where there is one, and the formats that are read: missing file,
/// other format, missing or superfluous numbers, NaN, focal lengths that are not positive, skew, models that are not
/// supported.
std::vector<CalibrationEntry> ReadCalibration(const std::filesystem::path& path, PixelOrigin text_origin);

}  // namespace rilievo::io
