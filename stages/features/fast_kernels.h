// The kernels of FAST, one table a processor level: scores of a row, maxima of scores.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

namespace rilievo::features {

namespace fast {

/// Values that a kernel may read or write beyond the end of a row.
inline constexpr int kOvershoot = 64;

struct ScoreRow {
  const std::int16_t* rows[7];  ///< pixels in 0..32767, rows y - 3 .. y + 3; columns -3 .. count + 2 are read
  int count = 0;
  int arc = 9;             ///< 9 or 12
  std::int16_t floor = 0;  ///< no score below this one is told from it
  std::int16_t* out;       ///< max(floor, score): a corner at thresholds below its score
};

struct MaximaRow {
  const std::int16_t* rows[3];  ///< scores; columns -1 .. count are read
  int count = 0;
  std::int16_t floor = 0;
};

}  // namespace fast

struct FastKernels {
  std::string_view name;
  void (*scores)(const fast::ScoreRow&) = nullptr;
  /// Columns of scores above the floor that are largest among their 8 neighbours (of equal ones the first), ascending.
  int (*maxima)(const fast::MaximaRow&, std::int32_t* columns) = nullptr;
  bool is_supported = true;
};

extern const FastKernels kFastScalar, kFastAvx2, kFastAvx512;

std::span<const FastKernels> AllFastKernels();
/// As ChooseSurfKernels.
const FastKernels& ChooseFastKernels(std::string_view name);

}  // namespace rilievo::features
