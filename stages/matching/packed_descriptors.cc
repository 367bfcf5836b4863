// Packs descriptors for a kernel (docs/decisions/0006-matching.md, 0010-descriptor-bytes.md).
#include "stages/matching/packed_descriptors.h"

#include <emmintrin.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>

namespace rilievo::matching {
namespace {

static_assert(kRowsPerBlock <= kIndexCount);
static_assert(2 * std::int64_t{kLargestKeyNorm_sq} * (1 << kIndexBits) + 2 * (1 << kIndexBits) < BestTwo::kNone);
/// Largest |d^2 - rest_sq| with bytes around 128: 3 N + 256 sqrt(128 N) (docs/decisions/0010), here with sqrt(128 N) <=
/// 3168.
static_assert(4 * std::int64_t{kLargestSignedShorts_sq} * (1 << kIndexBits) + 2 * (1 << kIndexBits) < BestTwo::kNone);
static_assert(std::int64_t{3168} * 3168 >= std::int64_t{128} * kLargestSignedBytes_sq);
static_assert((3 * std::int64_t{kLargestSignedBytes_sq} + 256 * 3168 + 1) * (1 << kIndexBits) + 2 * (1 << kIndexBits) <
              BestTwo::kNone);

/// A sketch as bytes: |d^2 - rest_sq| <= 3 N + 256 S; as shorts: 4 N.
static_assert((3 * std::int64_t{kLargestSketchNorm_sq} + 256 * kLargestSketchSum + 1) * (1 << kIndexBits) +
                  2 * (1 << kIndexBits) <
              BestTwo::kNone);
static_assert(4 * std::int64_t{kLargestSketchNorm_sq} * (1 << kIndexBits) + 2 * (1 << kIndexBits) < BestTwo::kNone);
static_assert(kDescriptorBytes % 8 == 0 && kSketchBytes % 8 == 0);

/// Sums of the differences of the bytes from a centre.
struct Moments {
  std::int32_t sum = 0, norm_sq = 0;

  /// Of `length` bytes taken from 0: those from `center`.
  Moments From(std::int32_t center, std::size_t length) const {
    const auto n = static_cast<std::int32_t>(length);
    return {sum - n * center, norm_sq - 2 * center * sum + n * center * center};
  }
};

/// The four 32-bit lanes of a vector.
std::int32_t SumOfLanes(__m128i v) {
  v = _mm_add_epi32(v, _mm_shuffle_epi32(v, _MM_SHUFFLE(1, 0, 3, 2)));
  return _mm_cvtsi128_si32(_mm_add_epi32(v, _mm_shuffle_epi32(v, _MM_SHUFFLE(2, 3, 0, 1))));
}

std::vector<Moments> MomentsOf(const ByteRows& descriptors) {
  std::vector<Moments> moments(descriptors.count);
  const __m128i zero = _mm_setzero_si128();
  for (std::size_t i = 0; i < descriptors.count; ++i) {
    __m128i sum = zero, norm_sq = zero;
    for (std::size_t k = 0; k < descriptors.length; k += 8) {
      const __m128i bytes = _mm_loadl_epi64(reinterpret_cast<const __m128i*>(descriptors[i].data() + k));
      const __m128i wide = _mm_unpacklo_epi8(bytes, zero);
      sum = _mm_add_epi32(sum, _mm_sad_epu8(bytes, zero));
      norm_sq = _mm_add_epi32(norm_sq, _mm_madd_epi16(wide, wide));
    }
    moments[i] = {SumOfLanes(sum), SumOfLanes(norm_sq)};
  }
  return moments;
}

Centers AllowedCenters(std::span<const Moments> moments, Encoding encoding, std::size_t length) {
  const std::int32_t limit_sq = encoding == Encoding::kBytes ? kLargestSignedBytes_sq : kLargestSignedShorts_sq;
  const auto all = [&](auto&& holds) { return std::all_of(moments.begin(), moments.end(), holds); };
  if (length == kSketchBytes)
    return {.zero = false, .middle = all([&](const Moments& moment) {
                             const Moments m = moment.From(kSignedCenter, length);
                             return m.norm_sq <= kLargestSketchNorm_sq && std::abs(m.sum) <= kLargestSketchSum;
                           })};
  return {.zero = all([](const Moments& m) { return m.norm_sq <= kLargestKeyNorm_sq; }),
          .middle = all([&](const Moments& m) { return m.From(kSignedCenter, length).norm_sq <= limit_sq; })};
}

/// Arithmetic of keys is modulo 2^32: intermediate values may wrap, the keys themselves fit.
std::int32_t Wrap(std::uint32_t value) { return static_cast<std::int32_t>(value); }

/// Word k of a descriptor.
std::uint32_t WordOfBytes(std::span<const std::uint8_t> descriptor, std::size_t k) {
  std::uint32_t word = 0;
  std::memcpy(&word, descriptor.data() + 4 * k, 4);
  return word;
}
std::uint32_t WordOfShorts(std::span<const std::uint8_t> descriptor, std::size_t k, std::int32_t center) {
  const auto half = [&](std::size_t i) { return static_cast<std::uint16_t>(descriptor[i] - center); };
  return half(2 * k) | (std::uint32_t{half(2 * k + 1)} << 16);
}

void PackRows(const ByteRows& descriptors, const Kernel& kernel, PackedDescriptors& packed) {
  const std::size_t words = packed.words;
  packed.rows.resize(descriptors.count * words);
  std::uint32_t* out = packed.rows.data();
  for (std::size_t i = 0; i < descriptors.count; ++i) {
    const std::span<const std::uint8_t> descriptor = descriptors[i];
    if (kernel.encoding == Encoding::kBytes)
      for (std::size_t k = 0; k < words; ++k) *out++ = WordOfBytes(descriptor, k) ^ 0x80808080U;
    else
      for (std::size_t k = 0; k < words; ++k) *out++ = WordOfShorts(descriptor, k, packed.center);
  }
}

void PackPanels(const ByteRows& descriptors, const Kernel& kernel, PackedDescriptors& packed) {
  const std::size_t width = kernel.PanelColumns(), words = packed.words;
  packed.panels.resize((descriptors.count + width - 1) / width * width * words);
  for (std::size_t begin = 0; begin < descriptors.count; begin += width) {
    const std::size_t columns = std::min(width, descriptors.count - begin);
    std::uint32_t* out = packed.panels.data() + begin * words;
    if (columns < width) std::fill_n(out, width * words, 0U);
    for (std::size_t k = 0; k < words; ++k, out += width) {
      if (kernel.encoding == Encoding::kBytes)
        for (std::size_t j = 0; j < columns; ++j) out[j] = WordOfBytes(descriptors[begin + j], k);
      else
        for (std::size_t j = 0; j < columns; ++j) out[j] = WordOfShorts(descriptors[begin + j], k, packed.center);
    }
  }
}

void PackKeyParts(std::span<const Moments> moments, std::size_t length, const Kernel& kernel,
                  PackedDescriptors& packed) {
  const bool bytes = kernel.encoding == Encoding::kBytes;
  const std::size_t width = kernel.PanelColumns();
  packed.rest_sq.resize(moments.size());
  packed.constants.resize(moments.size());
  // Columns beyond the last are zero and carry the largest key: they never displace a real one.
  packed.bases.assign((moments.size() + width - 1) / width * width, BestTwo::kNone);
  for (std::size_t i = 0; i < moments.size(); ++i) {
    const Moments m = moments[i].From(packed.center, length);
    const std::int32_t base_sq = m.norm_sq - (bytes && packed.center == 0 ? 256 * m.sum : 0);
    const auto vector = static_cast<std::uint32_t>(i / kernel.lanes % kIndexCount);
    packed.bases[i] = Wrap((static_cast<std::uint32_t>(base_sq) << kIndexBits) + vector);
    packed.rest_sq[i] = m.norm_sq + (bytes && packed.center != 0 ? 256 * m.sum : 0);
    const auto row = static_cast<std::uint32_t>(i % kRowsPerBlock);
    packed.constants[i] = Wrap((static_cast<std::uint32_t>(packed.rest_sq[i]) << kIndexBits) + row);
  }
}

}  // namespace

PackedDescriptors Pack(ByteRows descriptors, const Kernel& kernel, std::optional<std::int32_t> center) {
  PackedDescriptors packed;
  packed.count = descriptors.count;
  packed.words = kernel.Words(descriptors.length);
  if (kernel.sweep == nullptr || descriptors.count == 0) return packed;
  const std::vector<Moments> moments = MomentsOf(descriptors);
  packed.centers = AllowedCenters(moments, kernel.encoding, descriptors.length);
  packed.center = center.value_or(packed.centers.zero ? 0 : kSignedCenter);
  if (packed.center == 0 ? !packed.centers.zero : !packed.centers.middle) return packed;
  PackRows(descriptors, kernel, packed);
  PackPanels(descriptors, kernel, packed);
  PackKeyParts(moments, descriptors.length, kernel, packed);
  return packed;
}

std::size_t PackedBytes(std::size_t count, std::size_t length, Encoding encoding) {
  // Rows and panels, three integers, and the moments while it is packed.
  return (2 * length * (encoding == Encoding::kBytes ? 1 : 2) + 12 + 8) * (count + 64);
}

}  // namespace rilievo::matching
