// AVX-512 VNNI sweep: 6 rows x 64 columns of dot products in 24 accumulators, then best two of rows and columns.
// Nothing of the standard library is called here: an inline function compiled for AVX-512 could be linked in
// everywhere. g++ 12's own header reads a vector that is undefined by intent (its bug 105593).
#pragma GCC diagnostic ignored "-Wuninitialized"
#include <immintrin.h>

#include "stages/matching/matching_kernels.h"
#include "stages/matching/unrolled.h"

namespace rilievo::matching {
namespace {

constexpr std::size_t kLanes = 16, kVectors = 4, kRows = 6;

/// _mm512_dpbusd_epi32(sum, column, row), written out because g++ 12 copies the accumulator before and after it in a
/// loop.
[[gnu::always_inline]] inline __m512i AddProducts(__m512i sum, __m512i column, __m512i row) {
  asm("vpdpbusd %2, %1, %0" : "+v"(sum) : "v"(column), "v"(row));
  return sum;
}

/// Rows [row, row + kCount) of the block against one panel.
template <std::size_t kWords, std::size_t kCount>
void SweepTile(const SweepBlock& block, std::size_t row, std::size_t panel) {
  __m512i dot[kCount][kVectors];
  Unrolled<kCount>(
      [&]<std::size_t r> { Unrolled<kVectors>([&]<std::size_t v> { dot[r][v] = _mm512_setzero_si512(); }); });
  const std::uint32_t* rows = block.rows + row * kWords;
  const std::uint32_t* columns = block.panels + panel * (kWords * kLanes * kVectors);
  for (std::size_t k = 0; k < kWords; ++k, ++rows, columns += kLanes * kVectors) {
    __m512i column[kVectors];
    Unrolled<kVectors>([&]<std::size_t v> { column[v] = _mm512_loadu_si512(columns + v * kLanes); });
    Unrolled<kCount>([&]<std::size_t r> {
      const __m512i row_word = _mm512_set1_epi32(static_cast<int>(rows[r * kWords]));
      Unrolled<kVectors>([&]<std::size_t v> { dot[r][v] = AddProducts(dot[r][v], column[v], row_word); });
    });
  }
  const std::int32_t* bases = block.column_bases + panel * (kVectors * kLanes);
  Unrolled<kCount>([&]<std::size_t r> {
    std::int32_t* keys = block.row_keys + (row + r) * (2 * kLanes);
    __m512i first = _mm512_loadu_si512(keys), second = _mm512_loadu_si512(keys + kLanes);
    Unrolled<kVectors>([&]<std::size_t v> {
      dot[r][v] = _mm512_sub_epi32(_mm512_loadu_si512(bases + v * kLanes), _mm512_slli_epi32(dot[r][v], 12));
      second = _mm512_min_epi32(second, _mm512_max_epi32(first, dot[r][v]));
      first = _mm512_min_epi32(first, dot[r][v]);
    });
    _mm512_storeu_si512(keys, first);
    _mm512_storeu_si512(keys + kLanes, second);
  });
  Unrolled<kVectors>([&]<std::size_t v> {
    std::int32_t* keys = block.column_keys + (panel * kVectors + v) * (2 * kLanes);
    __m512i first = _mm512_loadu_si512(keys), second = _mm512_loadu_si512(keys + kLanes);
    Unrolled<kCount>([&]<std::size_t r> {
      const __m512i key = _mm512_add_epi32(dot[r][v], _mm512_set1_epi32(block.row_constants[row + r]));
      second = _mm512_min_epi32(second, _mm512_max_epi32(first, key));
      first = _mm512_min_epi32(first, key);
    });
    _mm512_storeu_si512(keys, first);
    _mm512_storeu_si512(keys + kLanes, second);
  });
}

template <std::size_t kWords>
void SweepPanels(const SweepBlock& block) {
  const std::size_t whole = block.row_count - block.row_count % kRows;
  for (std::size_t panel = 0; panel < block.panel_count; ++panel) {
    for (std::size_t row = 0; row < whole; row += kRows) SweepTile<kWords, kRows>(block, row, panel);
    for (std::size_t row = whole; row < block.row_count; ++row) SweepTile<kWords, 1>(block, row, panel);
  }
}

}  // namespace

void SweepAvx512(const SweepBlock& block) {
  block.words == kSketchBytes / 4 ? SweepPanels<kSketchBytes / 4>(block) : SweepPanels<kDescriptorBytes / 4>(block);
}

}  // namespace rilievo::matching
