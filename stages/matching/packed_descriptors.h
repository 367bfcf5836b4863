// The descriptors of one image as the sweeps of a kernel read them: packed once an image, for all of its pairs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <new>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "block/features.h"
#include "stages/matching/matching_kernels.h"

namespace rilievo::matching {

/// Starts vectors on a cache line, so that no 64-byte load of a kernel straddles two.
template <class T>
struct LineAllocator {
  using value_type = T;
  static constexpr std::align_val_t kLine{64};
  T* allocate(std::size_t count) { return static_cast<T*>(::operator new(count * sizeof(T), kLine)); }
  void deallocate(T* memory, std::size_t) { ::operator delete(memory, kLine); }
  /// Elements begin undefined where no value is given: they are written next.
  void construct(T* place) { ::new (static_cast<void*>(place)) T; }
  template <class... A>
  void construct(T* place, A&&... arguments) {
    ::new (static_cast<void*>(place)) T(std::forward<A>(arguments)...);
  }
  friend bool operator==(LineAllocator, LineAllocator) { return true; }
};

template <class T>
using LineVector = std::vector<T, LineAllocator<T>>;

/// Index bits of a key: rows of a block, and vectors of columns of a sweep, are counted in them.
inline constexpr int kIndexBits = 11;
inline constexpr std::size_t kIndexCount = std::size_t{1} << kIndexBits;
/// Rows of a block: as many as the index bits name, so that columns are decoded seldom; a multiple of 4 and 6. Their
/// words and keys (at most 320 bytes a row) stream through the second-level cache.
inline constexpr std::size_t kRowsPerBlock = 2016;

/// Keys are 32 bits: squared distances, eleven bits of index and the sum of two indices must fit. The distance of two
/// descriptors without negative components is at most twice this.
inline constexpr std::int32_t kLargestKeyNorm_sq = 520'000;
/// Zero of signed descriptors, whose squared distance reaches four times the norm, and the bounds from it for kernels
/// of shorts and of bytes (docs/decisions/0010).
inline constexpr std::int32_t kSignedCenter = 128, kLargestSignedShorts_sq = 260'000, kLargestSignedBytes_sq = 78'400;

/// Bounds of a sketch from 128, which has both signs: of its squared norm and of the sum of its components.
inline constexpr std::int32_t kLargestSketchNorm_sq = 200'000, kLargestSketchSum = 1'700;

/// Byte vectors of one length, one after the other: descriptors or sketches.
struct ByteRows {
  const std::uint8_t* data = nullptr;
  std::size_t count = 0, length = 0;

  ByteRows() = default;
  ByteRows(const std::uint8_t* bytes, std::size_t rows, std::size_t row_length)
      : data(bytes), count(rows), length(row_length) {}
  ByteRows(std::span<const Descriptor> descriptors)  // NOLINT: the same thing by another name
      : ByteRows(descriptors.empty() ? nullptr : descriptors.front().data(), descriptors.size(), kDescriptorBytes) {}
  std::span<const std::uint8_t> operator[](std::size_t i) const { return {data + i * length, length}; }
};

/// What stands for zero in the bytes of a pair (docs/decisions/0010): 0 or, for signed descriptors, whose norms from 0
/// are too large for the keys, 128. Distances do not depend on it. Which of them an image's norms allow.
struct Centers {
  bool zero = false, middle = false;
};

/// Both sides of a sweep. Words are padded to whole panels with columns of zero whose key is the largest.
struct PackedDescriptors {
  std::size_t count = 0, words = 0;
  Centers centers;
  std::int32_t center = 0;             ///< the one it is packed for: 0 where the norms allow it
  LineVector<std::uint32_t> rows;      ///< count x words
  LineVector<std::int32_t> rest_sq;    ///< by row: d^2 minus what its row keys hold
  LineVector<std::int32_t> constants;  ///< by row: (rest_sq << 11) + number in its block
  LineVector<std::uint32_t> panels;    ///< panels x words x panel columns
  LineVector<std::int32_t> bases;      ///< by column: its part of the key, and the number of its vector in its sweep

  bool IsPacked() const { return !rows.empty(); }
};

/// Packs for the kernel, around 128 if `center` says so, else around what the norms allow; nothing where neither or
/// not `center` is allowed, or for the scalar kernel. Cost: some 1 us a hundred descriptors.
PackedDescriptors Pack(ByteRows descriptors, const Kernel& kernel, std::optional<std::int32_t> center = std::nullopt);

/// Upper bound of the bytes of the packed form, and of packing; without an encoding for the one that needs most.
std::size_t PackedBytes(std::size_t count, std::size_t length = kDescriptorBytes,
                        Encoding encoding = Encoding::kSignedShorts);

}  // namespace rilievo::matching
