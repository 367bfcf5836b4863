// The interior orientation as JSON, as scene files and reports hold it.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "geometry/camera_model.h"

namespace rilievo::io {

/// `model` (COLMAP's name), `fx_px fy_px cx_px cy_px`, `k1 k2 p1 p2 k3 k4 k5 k6`, in this order.
nlohmann::ordered_json CameraModelJson(const CameraModel& model);

}  // namespace rilievo::io
