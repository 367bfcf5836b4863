// The kernels that compare blocks of descriptors, one a file, and the choice among them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string_view>

namespace rilievo::matching {

/// Nearest and second nearest neighbour of one descriptor, by (squared distance, index).
struct BestTwo {
  static constexpr std::int32_t kNone = std::numeric_limits<std::int32_t>::max();
  std::int32_t first_sq = kNone, second_sq = kNone;  ///< squared Euclidean distances; kNone = no such neighbour
  std::uint32_t index = 0;                           ///< of the nearest
};

/// Bytes of a descriptor, and of its sketch (docs/decisions/0014): what a sweep can compare.
inline constexpr std::size_t kDescriptorBytes = 128, kSketchBytes = 56;

/// One block of a sweep. A descriptor or sketch is `words` 32-bit words in the encoding of the kernel. A column of a
/// panel carries the key base (c << 11) + panel * vectors + vector, a row the constant (r << 11) + row, c - 2 dot + r =
/// d^2 (docs/decisions/0006, 0010), where vector counts the `lanes`-wide vectors of a panel. Results are the two
/// smallest keys by row and lane and by column.
struct SweepBlock {
  std::size_t words;                  ///< of a descriptor or of a sketch
  const std::uint32_t* rows;          ///< row-major, row_count x words
  std::size_t row_count;              ///< at most 2048
  const std::int32_t* row_constants;  ///< row_count
  const std::uint32_t* panels;        ///< panel_count x words x panel_columns
  std::size_t panel_count;            ///< panel_count * vectors at most 2048
  const std::int32_t* column_bases;   ///< panel_count x panel_columns
  std::int32_t* row_keys;             ///< row_count x 2 x lanes: smallest keys, then second smallest
  std::int32_t* column_keys;          ///< panel_count x vectors x 2 x lanes, likewise
};

enum class Encoding : std::uint8_t {
  kBytes,         ///< words of four bytes; rows are a - 128 (signed), columns b (unsigned): dot = a.b - 128 * sum(b)
  kSignedShorts,  ///< words of two 16-bit integers, a and b or both minus 128: dot is the product of those
};

struct Kernel {
  std::string_view name;
  Encoding encoding = Encoding::kBytes;
  std::size_t lanes = 0;    ///< 0: no sweep, the scalar reference
  std::size_t vectors = 0;  ///< vectors a panel
  void (*sweep)(const SweepBlock&) = nullptr;
  bool is_supported = true;  ///< by this processor

  std::size_t Words(std::size_t bytes) const { return encoding == Encoding::kBytes ? bytes / 4 : bytes / 2; }
  std::size_t PanelColumns() const { return lanes * vectors; }
};

/// scalar, avx2, avx512, whether supported or not.
std::span<const Kernel> AllKernels();

/// The kernel of that name, or the widest supported one when `name` is empty. Throws Error(kUsage) for an unknown name
/// or one that this processor lacks.
const Kernel& ChooseKernel(std::string_view name);

/// Reference: compares rows [row_begin, row_end) of `a` (na x 128 bytes) with all of `b` (nb x 128 bytes), any byte
/// values. Fills rows[i] and updates columns[j]; call with ascending row ranges.
void CompareScalar(const std::uint8_t* a, std::size_t row_begin, std::size_t row_end, const std::uint8_t* b,
                   std::size_t nb, BestTwo* rows, BestTwo* columns);

void SweepAvx2(const SweepBlock& block);
void SweepAvx512(const SweepBlock& block);

}  // namespace rilievo::matching
