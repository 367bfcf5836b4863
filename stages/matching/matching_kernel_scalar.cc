// The reference comparison: plain integers, any descriptors.
#include "stages/matching/matching_kernels.h"

namespace rilievo::matching {
namespace {

std::int32_t SquaredDistance(const std::uint8_t* a, const std::uint8_t* b) {
  std::int32_t sum = 0;  // at most 128 * 255^2 = 8,323,200
  for (int k = 0; k < 128; ++k) {
    const auto difference = static_cast<std::int16_t>(a[k] - b[k]);
    sum += std::int32_t{difference} * difference;
  }
  return sum;
}

/// Indices arrive ascending, so a strict comparison leaves ties to the lower one.
void Offer(BestTwo& best, std::int32_t distance_sq, std::size_t index) {
  if (distance_sq < best.first_sq) {
    best = {.first_sq = distance_sq, .second_sq = best.first_sq, .index = static_cast<std::uint32_t>(index)};
  } else if (distance_sq < best.second_sq) {
    best.second_sq = distance_sq;
  }
}

}  // namespace

void CompareScalar(const std::uint8_t* a, std::size_t row_begin, std::size_t row_end, const std::uint8_t* b,
                   std::size_t nb, BestTwo* rows, BestTwo* columns) {
  for (std::size_t i = row_begin; i < row_end; ++i) {
    for (std::size_t j = 0; j < nb; ++j) {
      const std::int32_t distance_sq = SquaredDistance(a + 128 * i, b + 128 * j);
      Offer(rows[i], distance_sq, j);
      Offer(columns[j], distance_sq, i);
    }
  }
}

}  // namespace rilievo::matching
