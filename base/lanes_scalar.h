// The vector vocabulary of the float kernels, one lane wide: the reference that the wide ones equal bit by bit.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>

namespace rilievo::lanes {

/// Kernels are templates over such a type (docs/decisions/0009). F: kWidth floats, I: kWidth 32-bit integers, M: a mask
/// of them; S: kShorts 16-bit integers. F supports + - * / ; every operation is exactly rounded or exact, so that a
/// kernel whose lanes do not mix gives the same bytes at every width.
struct Scalar {
  static constexpr int kWidth = 1, kShorts = 1;
  using F = float;
  using I = std::int32_t;
  using M = bool;
  using S = std::int16_t;

  static F Set(float v) { return v; }
  static F Load(const float* p) { return *p; }
  static void Store(float* p, F v) { *p = v; }
  static F LoadU8(const std::uint8_t* p) { return *p; }
  static F LoadU16(const std::uint16_t* p) { return *p; }
  /// Rounds to nearest even; values in [0, 65535.5).
  static void StoreU16(std::uint16_t* p, F v) { *p = static_cast<std::uint16_t>(Round(v)); }
  /// even[0], odd[0], even[1], ...: rounded as StoreU16.
  static void StoreU16Interleaved(std::uint16_t* p, F even, F odd) {
    StoreU16(p, even);
    StoreU16(p + 1, odd);
  }
  static void StoreI(std::int32_t* p, I v) { *p = v; }

  /// a * b + c, rounded once. Without an FMA instruction: the product is exact in double; the sum is rounded to odd
  /// (Boldo & Melquiond 2008), after which rounding to float is innocuous.
  static F Fma(F a, F b, F c) {
    const double product = static_cast<double>(a) * static_cast<double>(b), addend = c;
    double sum = product + addend;
    const double rest = sum - product;
    const double error = (product - (sum - rest)) + (addend - rest);
    if (error != 0) {
      auto bits = std::bit_cast<std::int64_t>(sum);
      if ((bits & 1) == 0) sum = std::bit_cast<double>(bits + ((error > 0) == (sum > 0) ? 1 : -1));
    }
    return static_cast<float>(sum);
  }
  /// sum[0..8) += weights[0..8) * scale, rounded once each.
  static void AddScaled8(float* sum, const float* weights, float scale) {
    for (int i = 0; i < 8; ++i) sum[i] = Fma(weights[i], scale, sum[i]);
  }
  static F Sqrt(F v) { return std::sqrt(v); }
  static F Min(F a, F b) { return a < b ? a : b; }
  static F Max(F a, F b) { return a > b ? a : b; }
  static F Abs(F v) { return std::fabs(v); }
  static M Less(F a, F b) { return a < b; }
  static F Select(M mask, F if_true, F if_false) { return mask ? if_true : if_false; }

  static I Set(std::int32_t v) { return v; }
  static I Round(F v) { return static_cast<I>(std::nearbyintf(v)); }  ///< to nearest even
  static I Truncate(F v) { return static_cast<I>(v); }
  static F ToFloat(I v) { return static_cast<F>(v); }
  static I Add(I a, I b) { return a + b; }
  static I Mul(I a, I b) { return a * b; }
  static I And(I a, I b) { return a & b; }
  static I ShiftRight16(I a) { return static_cast<I>(static_cast<std::uint32_t>(a) >> 16); }
  /// The 32 bits at base + 2 * index[lane] bytes: two neighbouring 16-bit values, the first one in the low half.
  static I GatherPairs(const std::uint16_t* base, I index) {
    std::int32_t v;
    std::memcpy(&v, base + index, sizeof v);
    return v;
  }
  static I Gather(const std::int32_t* base, I index) { return base[index]; }

  static S LoadShorts(const std::int16_t* p) { return *p; }
  static S LoadShorts(const std::uint16_t* p) { return static_cast<S>(*p); }
  static void StoreShorts(std::int16_t* p, S v) { *p = v; }
  static S SetShorts(std::int16_t v) { return v; }
  static S SubShorts(S a, S b) { return static_cast<S>(static_cast<std::uint16_t>(a) - static_cast<std::uint16_t>(b)); }
  static S MaxShorts(S a, S b) { return a > b ? a : b; }
  static S MinShorts(S a, S b) { return a < b ? a : b; }
  /// One bit a lane where a > b.
  static std::uint32_t GreaterShorts(S a, S b) { return a > b ? 1U : 0U; }

  /// Integers below wrap modulo 2^32.
  static I LoadI(const std::int32_t* p) { return *p; }
  static I LoadU16I(const std::uint16_t* p) { return *p; }
  static I WrapAdd(I a, I b) { return static_cast<I>(static_cast<std::uint32_t>(a) + static_cast<std::uint32_t>(b)); }
  static I WrapSub(I a, I b) { return static_cast<I>(static_cast<std::uint32_t>(a) - static_cast<std::uint32_t>(b)); }
  static I ShiftRight(I a, int bits) { return static_cast<I>(static_cast<std::uint32_t>(a) >> bits); }
  /// Lane i becomes the sum of the lanes 0..i; of the last lane of that, a copy in every lane.
  static I PrefixSum(I v) { return v; }
  static I LastLane(I v) { return v; }
  /// One bit a lane where the mask is set.
  static std::uint32_t Bits(M mask) { return mask ? 1U : 0U; }
};

}  // namespace rilievo::lanes
