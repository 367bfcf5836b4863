// What happens to one extremum of det H: interpolation, orientation, descriptor.
#pragma once

#include "stages/features/feature.h"
#include "stages/features/surf.h"
#include "stages/features/surf_kernels.h"

namespace rilievo::features::surf {

/// det H around an extremum: [layer][row][column], the extremum at [1][1][1].
struct Neighborhood {
  float value[3][3][3];
};

struct Offset {
  double x = 0, y = 0, layer = 0;  ///< in samples and layers
  bool is_inside = false;          ///< at most kLargestOffset in each
};

/// The stationary point of the quadratic through the differences (Brown & Lowe 2002).
Offset Interpolate(const Neighborhood& around);

struct Direction {
  double cosine = 1, sine = 0;
};

/// The longest sum of responses in a sector of 60 degrees, at 72 positions of the sector (section 4.1).
Direction DirectionOf(const CircleResponses& responses);

/// In [0, 2 pi), from +x towards +y; below 1e-14 rad from the truth.
double AngleOf(const Direction& direction);

/// Unit norm, then byte = round(128 + 256 c) (docs/decisions/0010). All 128 for a patch without any gradient.
Descriptor ToBytes(const float (*sums)[kCells], int elements);

}  // namespace rilievo::features::surf
