// The vector vocabulary of the float kernels for AVX2 and FMA (see lanes_scalar.h). Only *_avx2.cc and *_avx512.cc
// files include it.
#pragma once

#include <immintrin.h>

#include <cstdint>

namespace rilievo::lanes {

struct Avx2 {
  static constexpr int kWidth = 8, kShorts = 16;
  using F = __m256;
  struct I {
    __m256i v;
  };
  using M = __m256;
  struct S {
    __m256i v;
  };

  static F Set(float v) { return _mm256_set1_ps(v); }
  static F Load(const float* p) { return _mm256_loadu_ps(p); }
  static void Store(float* p, F v) { _mm256_storeu_ps(p, v); }
  static F LoadU8(const std::uint8_t* p) {
    return _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(p))));
  }
  static F LoadU16(const std::uint16_t* p) {
    return _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(p))));
  }
  static void StoreU16(std::uint16_t* p, F v) {
    const __m256i i = _mm256_cvtps_epi32(v);
    _mm_storeu_si128(reinterpret_cast<__m128i*>(p),
                     _mm_packus_epi32(_mm256_castsi256_si128(i), _mm256_extracti128_si256(i, 1)));
  }
  static void StoreU16Interleaved(std::uint16_t* p, F even, F odd) {
    const __m256i both = _mm256_or_si256(_mm256_cvtps_epi32(even), _mm256_slli_epi32(_mm256_cvtps_epi32(odd), 16));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(p), both);
  }
  static void StoreI(std::int32_t* p, I v) { _mm256_storeu_si256(reinterpret_cast<__m256i*>(p), v.v); }

  static F Fma(F a, F b, F c) { return _mm256_fmadd_ps(a, b, c); }
  static void AddScaled8(float* sum, const float* weights, float scale) {
    _mm256_storeu_ps(sum, _mm256_fmadd_ps(_mm256_loadu_ps(weights), _mm256_set1_ps(scale), _mm256_loadu_ps(sum)));
  }
  static F Sqrt(F v) { return _mm256_sqrt_ps(v); }
  static F Min(F a, F b) { return _mm256_min_ps(a, b); }
  static F Max(F a, F b) { return _mm256_max_ps(a, b); }
  static F Abs(F v) { return _mm256_andnot_ps(_mm256_set1_ps(-0.0F), v); }
  static M Less(F a, F b) { return _mm256_cmp_ps(a, b, _CMP_LT_OQ); }
  static F Select(M mask, F if_true, F if_false) { return _mm256_blendv_ps(if_false, if_true, mask); }

  static I Set(std::int32_t v) { return {_mm256_set1_epi32(v)}; }
  static I Round(F v) { return {_mm256_cvtps_epi32(v)}; }
  static I Truncate(F v) { return {_mm256_cvttps_epi32(v)}; }
  static F ToFloat(I v) { return _mm256_cvtepi32_ps(v.v); }
  static I Add(I a, I b) { return {_mm256_add_epi32(a.v, b.v)}; }
  static I Mul(I a, I b) { return {_mm256_mullo_epi32(a.v, b.v)}; }
  static I And(I a, I b) { return {_mm256_and_si256(a.v, b.v)}; }
  static I ShiftRight16(I a) { return {_mm256_srli_epi32(a.v, 16)}; }
  static I GatherPairs(const std::uint16_t* base, I index) {
    return {_mm256_i32gather_epi32(reinterpret_cast<const int*>(base), index.v, 2)};
  }
  static I Gather(const std::int32_t* base, I index) { return {_mm256_i32gather_epi32(base, index.v, 4)}; }

  static S LoadShorts(const void* p) { return {_mm256_loadu_si256(static_cast<const __m256i*>(p))}; }
  static void StoreShorts(std::int16_t* p, S v) { _mm256_storeu_si256(reinterpret_cast<__m256i*>(p), v.v); }
  static S SetShorts(std::int16_t v) { return {_mm256_set1_epi16(v)}; }
  static S SubShorts(S a, S b) { return {_mm256_sub_epi16(a.v, b.v)}; }
  static S MaxShorts(S a, S b) { return {_mm256_max_epi16(a.v, b.v)}; }
  static S MinShorts(S a, S b) { return {_mm256_min_epi16(a.v, b.v)}; }
  static std::uint32_t GreaterShorts(S a, S b) {
    const __m256i greater = _mm256_cmpgt_epi16(a.v, b.v);
    const __m256i bytes = _mm256_permute4x64_epi64(_mm256_packs_epi16(greater, _mm256_setzero_si256()), 0xD8);
    return static_cast<std::uint32_t>(_mm256_movemask_epi8(bytes));
  }

  static I LoadI(const std::int32_t* p) { return {_mm256_loadu_si256(reinterpret_cast<const __m256i*>(p))}; }
  static I LoadU16I(const std::uint16_t* p) {
    return {_mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(p)))};
  }
  static I WrapAdd(I a, I b) { return {_mm256_add_epi32(a.v, b.v)}; }
  static I WrapSub(I a, I b) { return {_mm256_sub_epi32(a.v, b.v)}; }
  static I ShiftRight(I a, int bits) { return {_mm256_srl_epi32(a.v, _mm_cvtsi32_si128(bits))}; }
  static I PrefixSum(I a) {
    __m256i v = _mm256_add_epi32(a.v, _mm256_slli_si256(a.v, 4));
    v = _mm256_add_epi32(v, _mm256_slli_si256(v, 8));
    const __m256i low_total = _mm256_shuffle_epi32(_mm256_permute2x128_si256(v, v, 0x08), 0xFF);
    return {_mm256_add_epi32(v, low_total)};
  }
  static I LastLane(I v) { return {_mm256_permutevar8x32_epi32(v.v, _mm256_set1_epi32(7))}; }
  static std::uint32_t Bits(M mask) { return static_cast<std::uint32_t>(_mm256_movemask_ps(mask)); }
};

}  // namespace rilievo::lanes
