// The vector vocabulary of the kernels in double precision for AVX2 (see double_lanes_scalar.h). Only *_avx2.cc files
// include it.
#pragma once

#include <immintrin.h>

#include <cstdint>

namespace rilievo::lanes {

struct Avx2x64 {
  static constexpr int kWidth = 4;
  using D = __m256d;
  using M = __m256d;
  struct Index {
    __m128i v;
  };

  static D Set(double v) { return _mm256_set1_pd(v); }
  static D Load(const double* p) { return _mm256_loadu_pd(p); }
  static void Store(double* p, D v) { _mm256_storeu_pd(p, v); }
  static D Sqrt(D v) { return _mm256_sqrt_pd(v); }
  static D Abs(D v) { return _mm256_andnot_pd(_mm256_set1_pd(-0.0), v); }
  static M Less(D a, D b) { return _mm256_cmp_pd(a, b, _CMP_LT_OQ); }
  static M SignsDiffer(D a, D b) { return _mm256_xor_pd(a, b); }  // masks are their sign bits
  static M And(M a, M b) { return _mm256_and_pd(a, b); }
  static M Or(M a, M b) { return _mm256_or_pd(a, b); }
  static D Select(M mask, D if_true, D if_false) { return _mm256_blendv_pd(if_false, if_true, mask); }
  static std::uint32_t Bits(M mask) { return static_cast<std::uint32_t>(_mm256_movemask_pd(mask)); }
  static Index LoadIndex(const std::int32_t* p) { return {_mm_loadu_si128(reinterpret_cast<const __m128i*>(p))}; }
  static D Pick(const double* row, Index index) {
    // The form without a mask reads an undefined vector, of which g++ warns (its bug 105593).
    const __m256d all = _mm256_castsi256_pd(_mm256_set1_epi64x(-1));
    return _mm256_mask_i32gather_pd(_mm256_setzero_pd(), row, index.v, all, 8);
  }
};

}  // namespace rilievo::lanes
