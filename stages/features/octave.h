// One octave of SIFT's scale space, worked through in strips: its features, and the image of the next octave.
#pragma once

#include <cstdint>
#include <vector>

#include "base/run_context.h"
#include "stages/features/describer.h"
#include "stages/features/feature.h"
#include "stages/features/selection.h"
#include "stages/features/sift_kernels.h"

namespace rilievo::features {

/// A grey image in layer units (256 an 8-bit level).
struct Plane {
  int width_px = 0, height_px = 0;
  std::vector<std::uint16_t> pixels;
};

/// Thresholds of the detector; contrast as a share of the grey range (Lowe 2004, section 4).
struct SiftThresholds {
  double contrast = 0, edge_ratio = 0;
};

/// What an octave is computed from. `index` is -1 for the doubled image; pixels of it are 2^index image pixels wide and
/// its grid is nested in the image's (both begin at the same corner).
struct OctaveInput {
  const Input& source;  ///< image, mask, tiling
  int index = 0, width_px = 0, height_px = 0;
  double surplus_px2 = 0;       ///< of the blur's variance over the nominal one, in pixels of the octave squared
  const Plane* base = nullptr;  ///< layer 0; none for the first octave, which is computed from the image
  float gain = 256;             ///< layer units a grey value of the image
};

struct OctaveOutput {
  std::vector<Feature> features;  ///< in no particular order, pruned by the rule
  Plane next;                     ///< half the size
};

/// Every value is a function of its pixel's coordinates alone: the result does not depend on the tiling, and neither on
/// the kernels. An empty `describe`: keypoints only, without orientation.
OctaveOutput RunOctave(const OctaveInput& input, const SiftThresholds& thresholds, const Describer& describe,
                       const SelectionRule& rule, const SiftKernels& kernels, RunContext& context);

/// Bytes of the workspaces of one octave at once.
std::size_t OctaveWorkspaceBytes(int width_px, const Tiling& tiling);

}  // namespace rilievo::features
