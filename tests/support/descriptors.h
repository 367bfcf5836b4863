// Descriptors for tests of matching: random ones, ties, and second images that see some of the first one's features.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "base/rng.h"
#include "block/features.h"
#include "stages/matching/matching_kernels.h"

namespace rilievo::test {

using Descriptors = std::vector<Descriptor>;

inline Descriptors SiftLike(std::size_t count, std::uint64_t seed) {
  Rng rng(seed);
  Descriptors result(count);
  for (auto& descriptor : result) {
    std::array<double, 128> values{};
    double norm_sq = 0;
    for (double& v : values) {
      v = std::abs(rng.Normal());
      norm_sq += v * v;
    }
    for (std::size_t k = 0; k < 128; ++k)
      descriptor[k] = static_cast<std::uint8_t>(std::min(255.0, std::round(512 * values[k] / std::sqrt(norm_sq))));
  }
  return result;
}

inline Descriptors AnyBytes(std::size_t count, std::uint64_t seed, std::uint32_t low = 0, std::uint32_t high = 255) {
  Rng rng(seed);
  Descriptors result(count);
  for (auto& descriptor : result)
    for (auto& v : descriptor) v = static_cast<std::uint8_t>(low + rng.Below(high - low + 1));
  return result;
}

/// Few distinct descriptors: ties and duplicates everywhere.
inline Descriptors Ties(std::size_t count, std::uint64_t seed) {
  Rng rng(seed);
  Descriptors result(count);
  for (auto& descriptor : result) {
    const std::uint32_t pattern = rng.Below(7);
    for (std::size_t k = 0; k < 128; ++k)
      descriptor[k] = static_cast<std::uint8_t>(k % 7 == pattern ? 40 + rng.Below(2) * (k == 21) : 40);
  }
  return result;
}

/// `features` with noise, every other one, and the others, mixed.
inline Descriptors SecondView(const Descriptors& features, double noise, std::uint64_t seed,
                              const Descriptors& others) {
  Rng rng(seed);
  Descriptors result = others;
  for (std::size_t i = 0; i < features.size(); i += 2) {
    Descriptor noisy = features[i];
    for (auto& v : noisy) v = static_cast<std::uint8_t>(std::clamp(v + noise * rng.Normal(), 0.0, 255.0));
    result.push_back(noisy);
  }
  for (std::size_t i = result.size(); i > 1; --i)
    std::swap(result[i - 1], result[rng.Below(static_cast<std::uint32_t>(i))]);
  return result;
}
inline Descriptors SecondView(const Descriptors& features, double noise, std::uint64_t seed) {
  return SecondView(features, noise, seed, SiftLike(features.size() / 2, seed + 1));
}

/// Neighbouring cells and directions alike, as in those of photographs: what sketches are made for.
inline Descriptors SmoothSift(std::size_t count, std::uint64_t seed) {
  Rng rng(seed);
  Descriptors result(count);
  for (auto& descriptor : result) {
    std::array<double, 128> values{};
    for (int wave = 0; wave < 12; ++wave) {
      const double row = rng.Uniform(0, 1.5), column = rng.Uniform(0, 1.5), phase = rng.Uniform(0, 6.28);
      const double turn = 0.785 * (1 + rng.Below(2)), size = rng.Uniform(0.5, 1.5);
      for (std::size_t k = 0; k < 128; ++k)
        values[k] += size * std::cos(row * static_cast<double>(k / 32) + column * static_cast<double>(k / 8 % 4) +
                                     turn * static_cast<double>(k % 8) + phase);
    }
    double norm_sq = 0;
    for (double& v : values) {
      v = std::max(0.0, 1.5 + v + 0.4 * rng.Normal());
      norm_sq += v * v;
    }
    for (std::size_t k = 0; k < 128; ++k)
      descriptor[k] = static_cast<std::uint8_t>(std::min(255.0, std::round(512 * values[k] / std::sqrt(norm_sq))));
  }
  return result;
}

inline std::int32_t DistanceSq(const Descriptor& a, const Descriptor& b) {
  std::int32_t sum = 0;
  for (std::size_t k = 0; k < 128; ++k) sum += (a[k] - b[k]) * (a[k] - b[k]);
  return sum;
}

/// The two nearest of `candidates` (indices of `points`, any order) by a full sort of (squared distance, index).
inline matching::BestTwo NearestOf(const Descriptor& query, const Descriptors& points,
                                   const std::vector<std::uint32_t>& candidates) {
  std::vector<std::pair<std::int32_t, std::uint32_t>> all;
  for (const std::uint32_t j : candidates) all.emplace_back(DistanceSq(query, points[j]), j);
  std::sort(all.begin(), all.end());
  matching::BestTwo best;
  if (!all.empty()) best.first_sq = all[0].first, best.index = all[0].second;
  if (all.size() > 1) best.second_sq = all[1].first;
  return best;
}

}  // namespace rilievo::test
