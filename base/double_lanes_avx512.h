// The vector vocabulary of the kernels in double precision for AVX-512 F and DQ (see double_lanes_scalar.h). Only
// *_avx512.cc files include it.
#pragma once

#include <immintrin.h>

#include <cstdint>

namespace rilievo::lanes {

struct Avx512x64 {
  static constexpr int kWidth = 8;
  using D = __m512d;
  using M = __mmask8;
  struct Index {
    __m512i v;
  };

  static D Set(double v) { return _mm512_set1_pd(v); }
  static D Load(const double* p) { return _mm512_loadu_pd(p); }
  static void Store(double* p, D v) { _mm512_storeu_pd(p, v); }
  static D Sqrt(D v) { return _mm512_sqrt_pd(v); }
  static D Abs(D v) { return _mm512_abs_pd(v); }
  static M Less(D a, D b) { return _mm512_cmp_pd_mask(a, b, _CMP_LT_OQ); }
  static M SignsDiffer(D a, D b) { return _mm512_movepi64_mask(_mm512_castpd_si512(_mm512_xor_pd(a, b))); }
  static M And(M a, M b) { return static_cast<M>(a & b); }
  static M Or(M a, M b) { return static_cast<M>(a | b); }
  static D Select(M mask, D if_true, D if_false) { return _mm512_mask_blend_pd(mask, if_false, if_true); }
  static std::uint32_t Bits(M mask) { return mask; }
  static Index LoadIndex(const std::int32_t* p) {
    return {_mm512_cvtepi32_epi64(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(p)))};
  }
  static D Pick(const double* row, Index index) { return _mm512_permutexvar_pd(index.v, _mm512_loadu_pd(row)); }
};

}  // namespace rilievo::lanes
