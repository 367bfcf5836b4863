// Reprojection residuals of a model's observations, computed anew.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "block/block.h"
#include "block/model.h"

namespace rilievo::io {

/// Projected minus measured, in px; none when the image is not oriented or the point lies behind it.
std::optional<Eigen::Vector2d> ResidualPx(const Block& block, const Model& model, const Point& point,
                                          const Observation& observation);

/// Root mean square of the lengths of a point's residuals, in px; 0 when it has none.
double RmsResidualPx(const Block& block, const Model& model, const Point& point);

}  // namespace rilievo::io
