// The noise sum for vectors of kWidth floats; included by one file a instruction set, so everything has internal
// linkage.
#pragma once

#include <cstring>

#include "simulation/noise.h"

namespace rilievo::simulation {
namespace {

template <int kBytes>
struct Lanes;
template <>
struct Lanes<16> {
  typedef float F __attribute__((vector_size(16)));
  typedef std::int32_t I __attribute__((vector_size(16)));
  typedef std::uint32_t U __attribute__((vector_size(16)));
};
template <>
struct Lanes<32> {
  typedef float F __attribute__((vector_size(32)));
  typedef std::int32_t I __attribute__((vector_size(32)));
  typedef std::uint32_t U __attribute__((vector_size(32)));
};
template <>
struct Lanes<64> {
  typedef float F __attribute__((vector_size(64)));
  typedef std::int32_t I __attribute__((vector_size(64)));
  typedef std::uint32_t U __attribute__((vector_size(64)));
};

template <int kWidth>
struct NoiseSum {
  using F = typename Lanes<4 * kWidth>::F;
  using I = typename Lanes<4 * kWidth>::I;
  using U = typename Lanes<4 * kWidth>::U;

  static F Load(const float* p) {
    F v;
    std::memcpy(&v, p, sizeof v);
    return v;
  }
  static I Floor(F x) {
    const I truncated = __builtin_convertvector(x, I);
    return truncated + (__builtin_convertvector(truncated, F) > x);  // a true comparison is -1
  }
  static F Quintic(F t) { return t * t * t * (t * (t * 6.0F - 15.0F) + 10.0F); }
  static F Lerp(F t, F a, F b) { return a + t * (b - a); }

  /// Dot product of the corner's hashed gradient (each component uniform in [-1, 1]) with the offset from the corner.
  static F Corner(U hash, F x, F y, F z) {
    hash ^= hash >> 15;
    hash *= 0x2c1b3c6dU;
    hash ^= hash >> 13;
    const F gx = __builtin_convertvector((I)(hash & 1023U), F) - 511.5F;
    const F gy = __builtin_convertvector((I)((hash >> 10) & 1023U), F) - 511.5F;
    const F gz = __builtin_convertvector((I)((hash >> 20) & 1023U), F) - 511.5F;
    return (gx * x + gy * y) + gz * z;
  }

  static F Noise(const NoiseOctave& o, F px, F py, F pz) {
    const F qx = (o.rotation[0] * px + o.rotation[1] * py) + (o.rotation[2] * pz + o.offset[0]);
    const F qy = (o.rotation[3] * px + o.rotation[4] * py) + (o.rotation[5] * pz + o.offset[1]);
    const F qz = (o.rotation[6] * px + o.rotation[7] * py) + (o.rotation[8] * pz + o.offset[2]);
    const I ix = Floor(qx), iy = Floor(qy), iz = Floor(qz);
    const F x = qx - __builtin_convertvector(ix, F), y = qy - __builtin_convertvector(iy, F);
    const F z = qz - __builtin_convertvector(iz, F);
    constexpr std::uint32_t kX = 0x8da6b343U, kY = 0xd8163841U, kZ = 0xcb1ab31fU;
    const U x0 = (U)ix * kX + o.seed, x1 = x0 + kX, y0 = (U)iy * kY, y1 = y0 + kY, z0 = (U)iz * kZ, z1 = z0 + kZ;
    const F u = Quintic(x), v = Quintic(y), w = Quintic(z);
    const F r = x - 1.0F, s = y - 1.0F, t = z - 1.0F;
    const F a = Lerp(u, Corner(x0 ^ y0 ^ z0, x, y, z), Corner(x1 ^ y0 ^ z0, r, y, z));
    const F b = Lerp(u, Corner(x0 ^ y1 ^ z0, x, s, z), Corner(x1 ^ y1 ^ z0, r, s, z));
    const F c = Lerp(u, Corner(x0 ^ y0 ^ z1, x, y, t), Corner(x1 ^ y0 ^ z1, r, y, t));
    const F d = Lerp(u, Corner(x0 ^ y1 ^ z1, x, s, t), Corner(x1 ^ y1 ^ z1, r, s, t));
    return Lerp(w, Lerp(v, a, b), Lerp(v, c, d));
  }

  /// 1 below 0.5 cells a footprint, 0 above 0.9, smoothstep between.
  static F Fade(F cells_per_footprint) {
    F t = (0.9F - cells_per_footprint) * (1.0F / 0.4F);
    t = t < 0.0F ? F{} : t;
    t = t > 1.0F ? F{} + 1.0F : t;
    return t * t * (3.0F - 2.0F * t);
  }
  static bool AllZero(F v) {
    bool zero = true;
    for (int i = 0; i < kWidth; ++i) zero = zero && v[i] == 0.0F;
    return zero;
  }

  static F Sum(std::span<const NoiseOctave> octaves, F x, F y, F z, F footprint) {
    constexpr float kNorm = 1.0F / (511.5F * 0.1915F);  // gradient components to [-1, 1], noise to unit deviation
    F sum{};
    for (const NoiseOctave& octave : octaves) {
      const F fade = Fade(footprint * octave.frequency_per_m);
      if (AllZero(fade)) break;  // frequencies rise: the rest is zero as well
      sum += (fade * (octave.amplitude * kNorm)) * Noise(octave, x, y, z);
    }
    return sum;
  }

  static void Run(std::span<const NoiseOctave> octaves, const NoisePoints& p, float* values) {
    std::size_t i = 0;
    for (; i + kWidth <= p.count; i += kWidth) {
      const F v = Sum(octaves, Load(p.x_m + i), Load(p.y_m + i), Load(p.z_m + i), Load(p.footprint_m + i));
      std::memcpy(values + i, &v, sizeof v);
    }
    if (i == p.count) return;
    F tail[4]{};
    const std::size_t bytes = (p.count - i) * sizeof(float);
    const float* sources[4] = {p.x_m, p.y_m, p.z_m, p.footprint_m};
    for (int k = 0; k < 4; ++k) std::memcpy(&tail[k], sources[k] + i, bytes);
    const F v = Sum(octaves, tail[0], tail[1], tail[2], tail[3]);
    std::memcpy(values + i, &v, bytes);
  }
};

}  // namespace
}  // namespace rilievo::simulation
