// The parameter lists of COLMAP's camera models, in COLMAP's order.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "geometry/camera_model.h"

namespace rilievo::io {

std::size_t CameraParamCount(CameraModelKind kind);
std::vector<double> CameraParams(const CameraModel& model);
/// `params` must have CameraParamCount(kind) numbers.
CameraModel CameraFromParams(CameraModelKind kind, std::span<const double> params);

/// `model` with the smallest kind not below its own that holds all of its parameters (fx = fy for SIMPLE_ and RADIAL
/// kinds).
CameraModel WithSufficientKind(CameraModel model);

}  // namespace rilievo::io
