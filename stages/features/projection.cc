// A learnt projection: as it is stored, and as it describes a feature.
#include "stages/features/projection.h"

#include "base/check.h"
#include "stages/features/descriptor_bytes.h"

namespace rilievo::features {

Projection::Projection(const StoredProjection& stored, float gain)
    : inputs_(stored.inputs),
      columns_((stored.outputs + 63) / 64 * 64),
      weights_(static_cast<std::size_t>(inputs_ * columns_)),
      offsets_(static_cast<std::size_t>(columns_)) {
  RILIEVO_CHECK(columns_ <= 128);
  for (int o = 0; o < stored.outputs; ++o) {
    offsets_[static_cast<std::size_t>(o)] = gain * stored.offsets[o];
    for (int i = 0; i < inputs_; ++i) {
      weights_[static_cast<std::size_t>(i * columns_ + o)] =
          gain * stored.scales[o] * static_cast<float>(stored.weights[o * inputs_ + i]);
    }
  }
}

Descriptor Projection::Describe(const SiftKernels& kernels, const float* input) const {
  alignas(64) float output[128];
  kernels.multiply(input, 1, inputs_, weights_.data(), columns_, output);
  for (int o = 0; o < columns_; ++o) output[o] -= offsets_[static_cast<std::size_t>(o)];
  return SignedBytes(output, columns_);
}

}  // namespace rilievo::features
