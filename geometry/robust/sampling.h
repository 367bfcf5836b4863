// Random samples, orders and trial counts of robust estimation.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/rng.h"

namespace rilievo {

/// kSize different indices below n (n >= kSize), in the order they were drawn.
template <int kSize>
std::array<std::uint32_t, kSize> DrawSample(std::uint32_t n, Rng& rng) {
  std::array<std::uint32_t, kSize> sample{};
  for (int drawn = 0; drawn < kSize;) {
    const std::uint32_t candidate = rng.Below(n);
    bool fresh = true;
    for (int i = 0; i < drawn; ++i) fresh = fresh && sample[i] != candidate;
    if (fresh) sample[drawn++] = candidate;
  }
  return sample;
}

/// A random permutation of 0 .. n - 1 (Fisher & Yates).
std::vector<std::uint32_t> ShuffledOrder(std::size_t n, std::uint64_t seed);

/// Trials after which a sample of `sample_size` out of n free of outliers was drawn with this confidence, when
/// `inliers` of the n are good: log(1 - confidence) / log(1 - p), p = probability of one good sample drawn without
/// replacement. Between 1 and max_trials.
int RequiredTrials(std::size_t inliers, std::size_t n, int sample_size, double confidence, int max_trials);

}  // namespace rilievo
