// Normalises a SIFT histogram and packs it into bytes.
#include "stages/features/descriptor_bytes.h"

#include <algorithm>
#include <cmath>

namespace rilievo::features {
namespace {

constexpr int kElements = 128, kLanes = 16;

/// Sum of term(i) in the fixed order.
template <class F>
float Sum(F&& term) {
  float lane[kLanes];
  for (int k = 0; k < kLanes; ++k) lane[k] = term(k);
  for (int i = kLanes; i < kElements; i += kLanes)
    for (int k = 0; k < kLanes; ++k) lane[k] += term(i + k);
  for (int half = kLanes / 2; half > 0; half /= 2)
    for (int k = 0; k < half; ++k) lane[k] += lane[k + half];
  return lane[0];
}

}  // namespace

Descriptor SiftBytes(const float* histogram, bool root) {
  float value[kElements];
  Descriptor bytes{};
  const float norm = std::sqrt(Sum([&](int i) { return histogram[i] * histogram[i]; }));
  if (!(norm > 0)) return bytes;
  const float limit = 0.2F * norm;
  for (int i = 0; i < kElements; ++i) value[i] = std::min(histogram[i], limit);
  if (root) {
    const float scale = 1 / Sum([&](int i) { return value[i]; });
    for (float& v : value) v = 512.0F * std::sqrt(v * scale);
  } else {
    const float scale = 512.0F / std::sqrt(Sum([&](int i) { return value[i] * value[i]; }));
    for (float& v : value) v *= scale;
  }
  for (int i = 0; i < kElements; ++i)
    bytes[static_cast<std::size_t>(i)] = static_cast<std::uint8_t>(std::min(value[i], 255.0F) + 0.5F);
  return bytes;
}

}  // namespace rilievo::features
