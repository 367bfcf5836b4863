// Random numbers keyed by work item: the same pair of images draws the same samples on any machine and thread.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace rilievo {

/// Finaliser of SplitMix64 (Steele, Lea & Flood 2014): a bijective mix of 64 bits.
constexpr std::uint64_t Mix64(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

/// A seed from a base seed and the ids of a work item, e.g. SeedFor(seed, image_a, image_b).
template <class... Ids>
constexpr std::uint64_t SeedFor(std::uint64_t seed, Ids... ids) {
  ((seed = Mix64(seed ^ Mix64(static_cast<std::uint64_t>(ids)))), ...);
  return seed;
}

/// xoshiro256** (Blackman & Vigna 2018). Distributions are our own, so results do not depend on the standard library.
class Rng {
 public:
  explicit Rng(std::uint64_t seed) {
    for (auto& word : state_) word = seed = Mix64(seed);
  }
  std::uint64_t Next() {
    const std::uint64_t result = Rotate(state_[1] * 5, 7) * 9;
    const std::uint64_t t = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= t;
    state_[3] = Rotate(state_[3], 45);
    return result;
  }
  /// Uniform integer in [0, n), n > 0; multiply-shift, bias below 2^-32 for n < 2^32.
  std::uint32_t Below(std::uint32_t n) { return static_cast<std::uint32_t>(((Next() >> 32) * n) >> 32); }
  /// Uniform in [0, 1).
  double Uniform() { return static_cast<double>(Next() >> 11) * 0x1.0p-53; }
  double Uniform(double low, double high) { return low + (high - low) * Uniform(); }
  /// Standard normal (Box-Muller, one of the two values).
  double Normal() {
    const double u = 1.0 - Uniform();
    return std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * std::numbers::pi * Uniform());
  }

 private:
  static constexpr std::uint64_t Rotate(std::uint64_t x, int k) { return (x << k) | (x >> (64 - k)); }
  std::uint64_t state_[4];
};

}  // namespace rilievo
