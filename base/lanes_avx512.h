// The vector vocabulary of the float kernels for AVX-512 F, BW, DQ and VL (see lanes_scalar.h). Only *_avx512.cc files
// include it.
#pragma once

#include <immintrin.h>

#include <cstdint>

namespace rilievo::lanes {

struct Avx512 {
  static constexpr int kWidth = 16, kShorts = 32;
  using F = __m512;
  struct I {
    __m512i v;
  };
  using M = __mmask16;
  struct S {
    __m512i v;
  };

  static F Set(float v) { return _mm512_set1_ps(v); }
  static F Load(const float* p) { return _mm512_loadu_ps(p); }
  static void Store(float* p, F v) { _mm512_storeu_ps(p, v); }
  static F LoadU8(const std::uint8_t* p) {
    return _mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(p))));
  }
  static F LoadU16(const std::uint16_t* p) {
    return _mm512_cvtepi32_ps(_mm512_cvtepu16_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(p))));
  }
  static void StoreU16(std::uint16_t* p, F v) {
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(p), _mm512_cvtusepi32_epi16(_mm512_cvtps_epi32(v)));
  }
  static void StoreU16Interleaved(std::uint16_t* p, F even, F odd) {
    const __m512i both = _mm512_or_si512(_mm512_cvtps_epi32(even), _mm512_slli_epi32(_mm512_cvtps_epi32(odd), 16));
    _mm512_storeu_si512(p, both);
  }
  static void StoreI(std::int32_t* p, I v) { _mm512_storeu_si512(p, v.v); }

  static F Fma(F a, F b, F c) { return _mm512_fmadd_ps(a, b, c); }
  static void AddScaled8(float* sum, const float* weights, float scale) {
    _mm256_storeu_ps(sum, _mm256_fmadd_ps(_mm256_loadu_ps(weights), _mm256_set1_ps(scale), _mm256_loadu_ps(sum)));
  }
  static F Sqrt(F v) { return _mm512_sqrt_ps(v); }
  static F Min(F a, F b) { return _mm512_min_ps(a, b); }
  static F Max(F a, F b) { return _mm512_max_ps(a, b); }
  static F Abs(F v) { return _mm512_abs_ps(v); }
  static M Less(F a, F b) { return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ); }
  static F Select(M mask, F if_true, F if_false) { return _mm512_mask_blend_ps(mask, if_false, if_true); }

  static I Set(std::int32_t v) { return {_mm512_set1_epi32(v)}; }
  static I Round(F v) { return {_mm512_cvtps_epi32(v)}; }
  static I Truncate(F v) { return {_mm512_cvttps_epi32(v)}; }
  static F ToFloat(I v) { return _mm512_cvtepi32_ps(v.v); }
  static I Add(I a, I b) { return {_mm512_add_epi32(a.v, b.v)}; }
  static I Mul(I a, I b) { return {_mm512_mullo_epi32(a.v, b.v)}; }
  static I And(I a, I b) { return {_mm512_and_si512(a.v, b.v)}; }
  static I ShiftRight16(I a) { return {_mm512_srli_epi32(a.v, 16)}; }
  static I GatherPairs(const std::uint16_t* base, I index) { return {_mm512_i32gather_epi32(index.v, base, 2)}; }
  static I Gather(const std::int32_t* base, I index) { return {_mm512_i32gather_epi32(index.v, base, 4)}; }

  static S LoadShorts(const void* p) { return {_mm512_loadu_si512(p)}; }
  static void StoreShorts(std::int16_t* p, S v) { _mm512_storeu_si512(p, v.v); }
  static S SetShorts(std::int16_t v) { return {_mm512_set1_epi16(v)}; }
  static S SubShorts(S a, S b) { return {_mm512_sub_epi16(a.v, b.v)}; }
  static S MaxShorts(S a, S b) { return {_mm512_max_epi16(a.v, b.v)}; }
  static S MinShorts(S a, S b) { return {_mm512_min_epi16(a.v, b.v)}; }
  static std::uint32_t GreaterShorts(S a, S b) { return _mm512_cmpgt_epi16_mask(a.v, b.v); }

  static I LoadI(const std::int32_t* p) { return {_mm512_loadu_si512(p)}; }
  static I LoadU16I(const std::uint16_t* p) {
    return {_mm512_cvtepu16_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(p)))};
  }
  static I WrapAdd(I a, I b) { return {_mm512_add_epi32(a.v, b.v)}; }
  static I WrapSub(I a, I b) { return {_mm512_sub_epi32(a.v, b.v)}; }
  static I ShiftRight(I a, int bits) { return {_mm512_srl_epi32(a.v, _mm_cvtsi32_si128(bits))}; }
  static I PrefixSum(I a) {
    const __m512i zero = _mm512_setzero_si512();
    __m512i v = _mm512_add_epi32(a.v, _mm512_alignr_epi32(a.v, zero, 15));
    v = _mm512_add_epi32(v, _mm512_alignr_epi32(v, zero, 14));
    v = _mm512_add_epi32(v, _mm512_alignr_epi32(v, zero, 12));
    return {_mm512_add_epi32(v, _mm512_alignr_epi32(v, zero, 8))};
  }
  static I LastLane(I v) { return {_mm512_permutexvar_epi32(_mm512_set1_epi32(15), v.v)}; }
  static std::uint32_t Bits(M mask) { return mask; }
};

}  // namespace rilievo::lanes
