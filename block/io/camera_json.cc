// Writes the interior orientation as JSON.
#include "block/io/camera_json.h"

#include <nlohmann/json.hpp>
#include <string>

namespace rilievo::io {

nlohmann::ordered_json CameraModelJson(const CameraModel& m) {
  return {{"model", std::string(CameraModelName(m.kind))},
          {"fx_px", m.fx},
          {"fy_px", m.fy},
          {"cx_px", m.cx},
          {"cy_px", m.cy},
          {"k1", m.k1},
          {"k2", m.k2},
          {"p1", m.p1},
          {"p2", m.p2},
          {"k3", m.k3},
          {"k4", m.k4},
          {"k5", m.k5},
          {"k6", m.k6}};
}

}  // namespace rilievo::io
