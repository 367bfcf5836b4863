// AVX2 sweep: 4 rows x 16 columns of dot products of 16-bit integers (vpmaddwd), then best two of rows and columns.
// Nothing of the standard library is called here: an inline function compiled for AVX2 could be linked in everywhere.
#include <immintrin.h>

#include "stages/matching/matching_kernels.h"
#include "stages/matching/unrolled.h"

namespace rilievo::matching {
namespace {

constexpr std::size_t kLanes = 8, kVectors = 2, kRows = 4;

__m256i Load(const void* from) { return _mm256_loadu_si256(static_cast<const __m256i*>(from)); }
void Store(void* to, __m256i value) { _mm256_storeu_si256(static_cast<__m256i*>(to), value); }

/// Rows [row, row + kCount) of the block against one panel.
template <std::size_t kWords, std::size_t kCount>
void SweepTile(const SweepBlock& block, std::size_t row, std::size_t panel) {
  __m256i dot[kCount][kVectors];
  Unrolled<kCount>(
      [&]<std::size_t r> { Unrolled<kVectors>([&]<std::size_t v> { dot[r][v] = _mm256_setzero_si256(); }); });
  const std::uint32_t* rows = block.rows + row * kWords;
  const std::uint32_t* columns = block.panels + panel * (kWords * kLanes * kVectors);
  for (std::size_t k = 0; k < kWords; ++k, ++rows, columns += kLanes * kVectors) {
    __m256i column[kVectors];
    Unrolled<kVectors>([&]<std::size_t v> { column[v] = Load(columns + v * kLanes); });
    Unrolled<kCount>([&]<std::size_t r> {
      const __m256i row_word = _mm256_set1_epi32(static_cast<int>(rows[r * kWords]));
      Unrolled<kVectors>(
          [&]<std::size_t v> { dot[r][v] = _mm256_add_epi32(dot[r][v], _mm256_madd_epi16(column[v], row_word)); });
    });
  }
  const std::int32_t* bases = block.column_bases + panel * (kVectors * kLanes);
  Unrolled<kCount>([&]<std::size_t r> {
    std::int32_t* keys = block.row_keys + (row + r) * (2 * kLanes);
    __m256i first = Load(keys), second = Load(keys + kLanes);
    Unrolled<kVectors>([&]<std::size_t v> {
      dot[r][v] = _mm256_sub_epi32(Load(bases + v * kLanes), _mm256_slli_epi32(dot[r][v], 12));
      second = _mm256_min_epi32(second, _mm256_max_epi32(first, dot[r][v]));
      first = _mm256_min_epi32(first, dot[r][v]);
    });
    Store(keys, first);
    Store(keys + kLanes, second);
  });
  Unrolled<kVectors>([&]<std::size_t v> {
    std::int32_t* keys = block.column_keys + (panel * kVectors + v) * (2 * kLanes);
    __m256i first = Load(keys), second = Load(keys + kLanes);
    Unrolled<kCount>([&]<std::size_t r> {
      const __m256i key = _mm256_add_epi32(dot[r][v], _mm256_set1_epi32(block.row_constants[row + r]));
      second = _mm256_min_epi32(second, _mm256_max_epi32(first, key));
      first = _mm256_min_epi32(first, key);
    });
    Store(keys, first);
    Store(keys + kLanes, second);
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

void SweepAvx2(const SweepBlock& block) {
  block.words == kSketchBytes / 2 ? SweepPanels<kSketchBytes / 2>(block) : SweepPanels<kDescriptorBytes / 2>(block);
}

}  // namespace rilievo::matching
