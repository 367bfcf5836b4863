// Normalises descriptors and packs them into bytes.
#include "stages/features/descriptor_bytes.h"

#include <algorithm>
#include <cmath>

namespace rilievo::features {
namespace {

constexpr int kElements = 128, kLanes = 16;

/// Sum of term(i), i < count, in the fixed order.
template <class F>
float Sum(int count, F&& term) {
  float lane[kLanes];
  for (int k = 0; k < kLanes; ++k) lane[k] = term(k);
  for (int i = kLanes; i < count; i += kLanes)
    for (int k = 0; k < kLanes; ++k) lane[k] += term(i + k);
  for (int half = kLanes / 2; half > 0; half /= 2)
    for (int k = 0; k < half; ++k) lane[k] += lane[k + half];
  return lane[0];
}

}  // namespace

float SquaredNorm(const float* values, int count) {
  return Sum(count, [&](int i) { return values[i] * values[i]; });
}

void Normalise(float* values, int count) {
  const float norm = std::sqrt(SquaredNorm(values, count));
  if (!(norm > 0)) return;
  const float scale = 1 / norm;
  for (int i = 0; i < count; ++i) values[i] *= scale;
}

Descriptor SiftBytes(const float* histogram, bool root) {
  float value[kElements];
  Descriptor bytes{};
  const float norm = std::sqrt(SquaredNorm(histogram, kElements));
  if (!(norm > 0)) return bytes;
  const float limit = 0.2F * norm;
  for (int i = 0; i < kElements; ++i) value[i] = std::min(histogram[i], limit);
  if (root) {
    const float scale = 1 / Sum(kElements, [&](int i) { return value[i]; });
    for (float& v : value) v = 512.0F * std::sqrt(v * scale);
  } else {
    const float scale = 512.0F / std::sqrt(SquaredNorm(value, kElements));
    for (float& v : value) v *= scale;
  }
  for (int i = 0; i < kElements; ++i)
    bytes[static_cast<std::size_t>(i)] = static_cast<std::uint8_t>(std::min(value[i], 255.0F) + 0.5F);
  return bytes;
}

Descriptor SignedBytes(const float* values, int count) {
  const float norm = std::sqrt(SquaredNorm(values, count));
  const float scale = norm > kMostSignedNorm ? kMostSignedNorm / norm : 1.0F;
  Descriptor bytes;
  bytes.fill(128);
  for (int i = 0; i < count; ++i)
    bytes[static_cast<std::size_t>(i)] =
        static_cast<std::uint8_t>(std::min(std::max(128.5F + scale * values[i], 0.0F), 255.0F));
  return bytes;
}

}  // namespace rilievo::features
