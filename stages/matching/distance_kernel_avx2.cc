// Distances with AVX2: differences as 16-bit integers, squared and summed in pairs (vpmaddwd), four points at a time.
// Nothing of the standard library is called here: an inline function compiled for AVX2 could be linked in everywhere.
#include <immintrin.h>

#include "stages/matching/distance_kernels.h"
#include "stages/matching/unrolled.h"

namespace rilievo::matching {
namespace {

constexpr std::size_t kParts = 8;  ///< of 16 bytes

__m256i Widen(const std::uint8_t* bytes) {
  return _mm256_cvtepu8_epi16(_mm_loadu_si128(reinterpret_cast<const __m128i*>(bytes)));
}

/// Eight partial sums, each at most 16 * 255^2.
__m256i SquaresOf(const __m256i* query, const std::uint8_t* point) {
  __m256i sum = _mm256_setzero_si256();
  Unrolled<kParts>([&]<std::size_t k> {
    const __m256i difference = _mm256_sub_epi16(query[k], Widen(point + 16 * k));
    sum = _mm256_add_epi32(sum, _mm256_madd_epi16(difference, difference));
  });
  return sum;
}

/// The sums over all lanes of four vectors.
__m128i SumsOf(__m256i a, __m256i b, __m256i c, __m256i d) {
  const __m256i halves = _mm256_hadd_epi32(_mm256_hadd_epi32(a, b), _mm256_hadd_epi32(c, d));
  return _mm_add_epi32(_mm256_castsi256_si128(halves), _mm256_extracti128_si256(halves, 1));
}

}  // namespace

void DistancesAvx2(const std::uint8_t* query, const std::uint8_t* points, const std::uint32_t* indices,
                   std::size_t count, std::int32_t* out) {
  __m256i wide[kParts];
  Unrolled<kParts>([&]<std::size_t k> { wide[k] = Widen(query + 16 * k); });
  const auto squares = [&](std::size_t i) { return SquaresOf(wide, points + 128 * std::size_t{indices[i]}); };
  std::size_t i = 0;
  for (; i + 4 <= count; i += 4) {
    _mm_storeu_si128(reinterpret_cast<__m128i*>(out + i),
                     SumsOf(squares(i), squares(i + 1), squares(i + 2), squares(i + 3)));
  }
  for (; i < count; ++i) {
    const __m256i zero = _mm256_setzero_si256();
    out[i] = _mm_cvtsi128_si32(SumsOf(squares(i), zero, zero, zero));
  }
}

}  // namespace rilievo::matching
