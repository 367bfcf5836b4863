// A learnt projection: as it is stored, and as it describes a feature.
#pragma once

#include <cstdint>
#include <vector>

#include "block/features.h"
#include "stages/features/sift_kernels.h"

namespace rilievo::features {

/// Rows of 8-bit integers: output o of the input x is scales[o] * sum_i weights[o * inputs + i] x_i - offsets[o]. The
/// rows are orthonormal but for their rounding, the offsets project the mean of the inputs learnt from. Written by
/// features_eval learn (docs/decisions/0009).
struct StoredProjection {
  int inputs = 0, outputs = 0;
  const std::int8_t* weights = nullptr;
  const float* scales = nullptr;
  const float* offsets = nullptr;
};

extern const StoredProjection kGlohProjection, kPcaSiftProjection;

/// Ready for the kernels: by inputs, outputs padded to vectors.
class Projection {
 public:
  /// Outputs are multiplied by `gain`, which makes bytes of them (docs/decisions/0010).
  Projection(const StoredProjection& stored, float gain);

  /// `inputs` values to at most 128 signed bytes. Cost: inputs x outputs multiplications.
  Descriptor Describe(const SiftKernels& kernels, const float* input) const;

 private:
  int inputs_, columns_;
  std::vector<float> weights_, offsets_;
};

}  // namespace rilievo::features
