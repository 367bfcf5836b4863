// Distances with AVX-512: differences as 16-bit integers, squared and summed (vpdpwssd), four points at a time.
// Nothing of the standard library is called here: an inline function compiled for AVX-512 could be linked in
// everywhere. g++ 12's own header reads a vector that is undefined by intent (its bug 105593).
#pragma GCC diagnostic ignored "-Wuninitialized"
#include <immintrin.h>

#include "stages/matching/distance_kernels.h"
#include "stages/matching/unrolled.h"

namespace rilievo::matching {
namespace {

constexpr std::size_t kParts = 4;  ///< of 32 bytes

__m512i Widen(const std::uint8_t* bytes) {
  return _mm512_cvtepu8_epi16(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(bytes)));
}

/// Sixteen partial sums, each at most 8 * 255^2.
__m512i SquaresOf(const __m512i* query, const std::uint8_t* point) {
  __m512i sum = _mm512_setzero_si512();
  Unrolled<kParts>([&]<std::size_t k> {
    const __m512i difference = _mm512_sub_epi16(query[k], Widen(point + 32 * k));
    sum = _mm512_dpwssd_epi32(sum, difference, difference);
  });
  return sum;
}

/// The sums over all lanes of four vectors.
__m128i SumsOf(__m512i a, __m512i b, __m512i c, __m512i d) {
  const __m512i ab = _mm512_add_epi32(_mm512_unpacklo_epi32(a, b), _mm512_unpackhi_epi32(a, b));
  const __m512i cd = _mm512_add_epi32(_mm512_unpacklo_epi32(c, d), _mm512_unpackhi_epi32(c, d));
  const __m512i quarters = _mm512_add_epi32(_mm512_unpacklo_epi64(ab, cd), _mm512_unpackhi_epi64(ab, cd));
  const __m256i halves = _mm256_add_epi32(_mm512_castsi512_si256(quarters), _mm512_extracti64x4_epi64(quarters, 1));
  return _mm_add_epi32(_mm256_castsi256_si128(halves), _mm256_extracti128_si256(halves, 1));
}

}  // namespace

void DistancesAvx512(const std::uint8_t* query, const std::uint8_t* points, const std::uint32_t* indices,
                     std::size_t count, std::int32_t* out) {
  __m512i wide[kParts];
  Unrolled<kParts>([&]<std::size_t k> { wide[k] = Widen(query + 32 * k); });
  const auto squares = [&](std::size_t i) { return SquaresOf(wide, points + 128 * std::size_t{indices[i]}); };
  std::size_t i = 0;
  for (; i + 4 <= count; i += 4) {
    _mm_storeu_si128(reinterpret_cast<__m128i*>(out + i),
                     SumsOf(squares(i), squares(i + 1), squares(i + 2), squares(i + 3)));
  }
  for (; i < count; ++i) {
    const __m512i zero = _mm512_setzero_si512();
    out[i] = _mm_cvtsi128_si32(SumsOf(squares(i), zero, zero, zero));
  }
}

}  // namespace rilievo::matching
