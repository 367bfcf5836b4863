// Packs descriptors for a kernel, sweeps block by block and decodes its keys (docs/decisions/0006-matching.md).
#include "stages/matching/two_nearest.h"

#include <algorithm>
#include <cstring>
#include <new>
#include <optional>

namespace rilievo::matching {
namespace {

constexpr int kIndexBits = 11;
constexpr std::size_t kIndexCount = std::size_t{1} << kIndexBits;
/// Rows of a sweep: their words and keys (at most 320 bytes a row) stay in the second-level cache; a multiple of 4
/// and 6.
constexpr std::size_t kRowsPerBlock = 1008;
/// Rows of the scalar reference between two polls for a stop, against all columns.
constexpr std::size_t kScalarComparisonsPerPoll = 1'000'000;
static_assert(2 * std::int64_t{kLargestKeyNorm_sq} * (1 << kIndexBits) + 2 * (1 << kIndexBits) < BestTwo::kNone);
static_assert(kRowsPerBlock <= kIndexCount);
/// Largest |d^2 - rest_sq| with bytes around 128: 3 N + 256 sqrt(128 N) (docs/decisions/0010), here with sqrt(128 N) <=
/// 3168.
static_assert(4 * std::int64_t{kLargestSignedShorts_sq} * (1 << kIndexBits) + 2 * (1 << kIndexBits) < BestTwo::kNone);
static_assert(std::int64_t{3168} * 3168 >= std::int64_t{128} * kLargestSignedBytes_sq);
static_assert((3 * std::int64_t{kLargestSignedBytes_sq} + 256 * 3168 + 1) * (1 << kIndexBits) + 2 * (1 << kIndexBits) <
              BestTwo::kNone);

/// Starts vectors on a cache line, so that no 64-byte load of a kernel straddles two.
template <class T>
struct LineAllocator {
  using value_type = T;
  static constexpr std::align_val_t kLine{64};
  T* allocate(std::size_t count) { return static_cast<T*>(::operator new(count * sizeof(T), kLine)); }
  void deallocate(T* memory, std::size_t) { ::operator delete(memory, kLine); }
  friend bool operator==(LineAllocator, LineAllocator) { return true; }
};

template <class T>
using LineVector = std::vector<T, LineAllocator<T>>;

struct Moments {
  std::int32_t sum = 0, norm_sq = 0;
};

/// Of the differences from `center`.
Moments MomentsOf(const Descriptor& descriptor, std::int32_t center) {
  Moments m;
  for (const std::int32_t value : descriptor) {
    m.sum += value - center;
    m.norm_sq += (value - center) * (value - center);
  }
  return m;
}

std::int32_t LargestNorm(std::span<const Descriptor> descriptors, std::int32_t center) {
  std::int32_t largest = 0;
  for (const auto& d : descriptors) largest = std::max(largest, MomentsOf(d, center).norm_sq);
  return largest;
}

/// What stands for zero in the bytes (docs/decisions/0010): 0, or 128 for signed descriptors, whose norms from 0 are
/// too large for the keys. Distances do not depend on it. None if the keys hold neither.
std::optional<std::int32_t> CenterOf(std::span<const Descriptor> a, std::span<const Descriptor> b, Encoding encoding) {
  const auto fits = [&](std::int32_t center, std::int32_t limit) {
    return LargestNorm(a, center) <= limit && LargestNorm(b, center) <= limit;
  };
  if (fits(0, kLargestKeyNorm_sq)) return 0;
  const std::int32_t limit = encoding == Encoding::kBytes ? kLargestSignedBytes_sq : kLargestSignedShorts_sq;
  if (fits(kSignedCenter, limit)) return kSignedCenter;
  return std::nullopt;
}

/// Arithmetic of keys is modulo 2^32: intermediate values may wrap, the keys themselves fit.
std::int32_t Wrap(std::uint32_t value) { return static_cast<std::int32_t>(value); }

/// Writes the words of one descriptor at out, out + stride, ...
void WriteWords(const Descriptor& descriptor, Encoding encoding, std::int32_t center, std::uint8_t flip,
                std::uint32_t* out, std::size_t stride) {
  if (encoding == Encoding::kBytes) {
    const std::uint32_t flips = flip * 0x01010101U;
    for (std::size_t k = 0; k < 32; ++k) {
      std::uint32_t word = 0;
      std::memcpy(&word, descriptor.data() + 4 * k, 4);
      out[k * stride] = word ^ flips;
    }
    return;
  }
  const auto half = [&](std::size_t k) { return static_cast<std::uint16_t>(descriptor[k] - center); };
  for (std::size_t k = 0; k < 64; ++k) out[k * stride] = half(2 * k) | (std::uint32_t{half(2 * k + 1)} << 16);
}

/// Columns of one sweep, at most what eleven index bits can name, packed in panels.
struct PackedColumns {
  std::size_t begin = 0, count = 0, panel_count = 0;
  LineVector<std::uint32_t> panels;
  LineVector<std::int32_t> bases, keys;
};

PackedColumns Pack(std::span<const Descriptor> b, std::size_t begin, std::size_t count, std::int32_t center,
                   const Kernel& kernel) {
  const std::size_t width = kernel.PanelColumns();
  PackedColumns packed{.begin = begin,
                       .count = count,
                       .panel_count = (count + width - 1) / width,
                       .panels = {},
                       .bases = {},
                       .keys = {}};
  packed.panels.assign(packed.panel_count * width * kernel.Words(), 0);
  // Columns beyond the last are zero and carry the largest key: they never displace a real one.
  packed.bases.assign(packed.panel_count * width, BestTwo::kNone);
  packed.keys.resize(2 * packed.panel_count * width);
  for (std::size_t j = 0; j < count; ++j) {
    const Descriptor& descriptor = b[begin + j];
    WriteWords(descriptor, kernel.encoding, center, 0,
               packed.panels.data() + (j / width) * width * kernel.Words() + j % width, width);
    const Moments m = MomentsOf(descriptor, center);
    const std::int32_t c = m.norm_sq - (kernel.encoding == Encoding::kBytes && center == 0 ? 256 * m.sum : 0);
    packed.bases[j] =
        Wrap((static_cast<std::uint32_t>(c) << kIndexBits) + static_cast<std::uint32_t>(j / kernel.lanes));
  }
  return packed;
}

/// rest_sq: d^2 minus what the row keys hold, |a|^2 or, with bytes around 128, |a|^2 + 256 sum(a).
struct PackedRows {
  LineVector<std::uint32_t> words;
  LineVector<std::int32_t> constants, rest_sq, keys;
};

PackedRows Pack(std::span<const Descriptor> rows, std::int32_t center, const Kernel& kernel) {
  PackedRows packed;
  packed.words.resize(rows.size() * kernel.Words());
  packed.keys.assign(rows.size() * 2 * kernel.lanes, BestTwo::kNone);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    WriteWords(rows[i], kernel.encoding, center, 0x80, packed.words.data() + i * kernel.Words(), 1);
    const Moments m = MomentsOf(rows[i], center);
    const std::int32_t rest_sq = m.norm_sq + (kernel.encoding == Encoding::kBytes && center != 0 ? 256 * m.sum : 0);
    packed.rest_sq.push_back(rest_sq);
    packed.constants.push_back(
        Wrap((static_cast<std::uint32_t>(rest_sq) << kIndexBits) + static_cast<std::uint32_t>(i)));
  }
  return packed;
}

/// Takes one more neighbour into account; ties go to the lower index, so the order of the offers is free.
void Offer(BestTwo& best, std::int32_t distance_sq, std::uint32_t index) {
  if (distance_sq < best.first_sq || (distance_sq == best.first_sq && index < best.index)) {
    best = {.first_sq = distance_sq, .second_sq = best.first_sq, .index = index};
  } else if (distance_sq < best.second_sq) {
    best.second_sq = distance_sq;
  }
}

/// A row key is (d^2 - rest_sq) << 11 plus the number of the vector, counted over the panels; the lane says the rest.
void DecodeRows(const PackedRows& rows, std::size_t column_begin, const Kernel& kernel, std::span<BestTwo> of_a) {
  for (std::size_t i = 0; i < of_a.size(); ++i) {
    for (std::size_t slot = 0; slot < 2 * kernel.lanes; ++slot) {
      const std::int32_t key = rows.keys[i * 2 * kernel.lanes + slot];
      if (key == BestTwo::kNone) continue;
      const std::size_t vector = static_cast<std::uint32_t>(key) % kIndexCount;
      Offer(of_a[i], (key >> kIndexBits) + rows.rest_sq[i],
            static_cast<std::uint32_t>(column_begin + vector * kernel.lanes + slot % kernel.lanes));
    }
  }
}

/// A column key is d^2 << 11 plus the numbers of the vector (known from the place) and of the row in its block.
void DecodeColumns(const PackedColumns& columns, std::size_t row_begin, const Kernel& kernel, std::span<BestTwo> of_b) {
  for (std::size_t j = 0; j < columns.count; ++j) {
    const std::size_t vector = j / kernel.lanes;
    for (std::size_t rank = 0; rank < 2; ++rank) {
      const std::int32_t key = columns.keys[(2 * vector + rank) * kernel.lanes + j % kernel.lanes];
      if (key == BestTwo::kNone) continue;
      const std::int32_t plain = key - static_cast<std::int32_t>(vector);
      Offer(of_b[columns.begin + j], plain >> kIndexBits,
            static_cast<std::uint32_t>(row_begin + static_cast<std::uint32_t>(plain) % kIndexCount));
    }
  }
}

void CompareAllScalar(std::span<const Descriptor> a, std::span<const Descriptor> b, NeighborTable& table,
                      const RunContext& context) {
  const std::size_t step = 1 + kScalarComparisonsPerPoll / (b.size() + 1);
  for (std::size_t row = 0; row < a.size(); row += step) {
    context.ThrowIfStopped();
    CompareScalar(a.front().data(), row, std::min(row + step, a.size()), b.front().data(), b.size(), table.of_a.data(),
                  table.of_b.data());
  }
}

}  // namespace

std::size_t TwoNearestBytes(std::size_t a, std::size_t b) {
  constexpr std::size_t kMostColumns = kIndexCount * 16, kBytesPerColumn = 256 + 4 + 8,
                        kBytesPerRow = 256 + 128 + 8 + 8;
  return sizeof(BestTwo) * (a + b) + kBytesPerColumn * (std::min(b, kMostColumns) + 64) + kBytesPerRow * kRowsPerBlock;
}

NeighborTable FindTwoNearest(std::span<const Descriptor> a, std::span<const Descriptor> b, const Kernel& kernel,
                             const RunContext& context) {
  NeighborTable table{.of_a = std::vector<BestTwo>(a.size()), .of_b = std::vector<BestTwo>(b.size())};
  if (a.empty() || b.empty()) return table;
  const auto center = kernel.sweep == nullptr ? std::nullopt : CenterOf(a, b, kernel.encoding);
  if (!center) {
    CompareAllScalar(a, b, table, context);
    return table;
  }
  const std::size_t columns_per_sweep = kIndexCount * kernel.lanes;
  for (std::size_t column = 0; column < b.size(); column += columns_per_sweep) {
    PackedColumns columns = Pack(b, column, std::min(columns_per_sweep, b.size() - column), *center, kernel);
    for (std::size_t row = 0; row < a.size(); row += kRowsPerBlock) {
      context.ThrowIfStopped();
      const std::size_t count = std::min(kRowsPerBlock, a.size() - row);
      PackedRows rows = Pack(a.subspan(row, count), *center, kernel);
      std::fill(columns.keys.begin(), columns.keys.end(), BestTwo::kNone);
      kernel.sweep({.rows = rows.words.data(),
                    .row_count = count,
                    .row_constants = rows.constants.data(),
                    .panels = columns.panels.data(),
                    .panel_count = columns.panel_count,
                    .column_bases = columns.bases.data(),
                    .row_keys = rows.keys.data(),
                    .column_keys = columns.keys.data()});
      DecodeRows(rows, column, kernel, std::span(table.of_a).subspan(row, count));
      DecodeColumns(columns, row, kernel, table.of_b);
    }
  }
  return table;
}

}  // namespace rilievo::matching
