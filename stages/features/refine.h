// Locates an extremum of the differences of Gaussians to a fraction of a sample (Brown & Lowe 2002).
#pragma once

#include <optional>

#include "stages/features/octave.h"

namespace rilievo::features {

/// The six layers around a strip; the difference d is layer d + 1 less layer d.
struct LayerViews {
  RingView layers[kLayers];
  int Difference(int d, int row, int column) const {
    const auto at = [&](const RingView& v) {
      return static_cast<int>(v.data[static_cast<std::ptrdiff_t>(row & v.row_mask) * v.stride + column]);
    };
    return at(layers[d + 1]) - at(layers[d]);
  }
};

struct Extremum {
  int scale = 0, row = 0, column = 0;           ///< sample
  double d_scale = 0, d_row = 0, d_column = 0;  ///< from the sample to the extremum, each below 1 in size
  double value = 0;                             ///< in layer units
  /// Second derivatives by column and row, layer units an octave pixel squared.
  double xx = 0, xy = 0, yy = 0;
};

/// No value for a repetition (an equal neighbour precedes it), an extremum that moves out of reach, has too little
/// contrast or lies on an edge. Rows and columns within kSearchReach_px of the sample are read.
std::optional<Extremum> Refine(const LayerViews& views, int scale, int row, int column,
                               const SiftThresholds& thresholds);

/// Covariance of the extremum's position in px^2 of the image for image noise of one grey level: the noise of the
/// difference's gradient through the inverse Hessian. `step_px` = pixels of the image an octave pixel.
struct PositionCovariance {
  double xx = 0, xy = 0, yy = 0;
};
PositionCovariance CovarianceOf(const Extremum& extremum, double step_px, double surplus_px2);

}  // namespace rilievo::features
