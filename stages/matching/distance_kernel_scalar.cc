// The reference for distances: plain integers.
#include "stages/matching/distance_kernels.h"

namespace rilievo::matching {

void DistancesScalar(const std::uint8_t* query, const std::uint8_t* points, const std::uint32_t* indices,
                     std::size_t count, std::int32_t* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint8_t* point = points + 128 * std::size_t{indices[i]};
    std::int32_t sum = 0;
    for (int k = 0; k < 128; ++k) {
      const auto difference = static_cast<std::int16_t>(query[k] - point[k]);
      sum += std::int32_t{difference} * difference;
    }
    out[i] = sum;
  }
}

}  // namespace rilievo::matching
