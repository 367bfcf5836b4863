// A camera: interior orientation and image size, shared by the images taken with it.
#pragma once

#include <string>

#include "base/ids.h"
#include "geometry/camera_model.h"

namespace rilievo {

enum class CalibrationSource { kGiven, kExif, kGuessed };

struct Camera {
  CameraId id;
  CameraModel model;
  int width_px = 0, height_px = 0;
  CalibrationSource source = CalibrationSource::kGiven;
  std::string label;  ///< where it came from, for reports
};

}  // namespace rilievo
