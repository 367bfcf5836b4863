// Little-endian byte writer and bounds-checked reader: the payloads of artifacts.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "base/error.h"

namespace rilievo {

static_assert(std::endian::native == std::endian::little, "artifacts are little endian");

class ByteWriter {
 public:
  template <class T>
  requires std::is_trivially_copyable_v<T>
  void Put(const T& value) { PutRaw(&value, sizeof value); }
  void PutString(std::string_view text) {
    Put<std::uint64_t>(text.size());
    PutRaw(text.data(), text.size());
  }
  /// Length prefix, then the elements' bytes.
  template <class T>
  requires std::is_trivially_copyable_v<T>
  void PutVector(std::span<const T> values) {
    Put<std::uint64_t>(values.size());
    PutRaw(values.data(), values.size_bytes());
  }
  template <class T>
  void PutVector(const std::vector<T>& values) {
    PutVector(std::span<const T>(values));
  }
  std::vector<std::byte> Take() { return std::move(bytes_); }

 private:
  void PutRaw(const void* data, std::size_t size) {
    const auto* begin = static_cast<const std::byte*>(data);
    bytes_.insert(bytes_.end(), begin, begin + size);
  }
  std::vector<std::byte> bytes_;
};

/// Throws Error(kInvalidInput) when asked for more than there is.
class ByteReader {
 public:
  explicit ByteReader(std::span<const std::byte> bytes) : rest_(bytes) {}
  template <class T>
  requires std::is_trivially_copyable_v<T> T Get() {
    T value;
    GetRaw(&value, sizeof value);
    return value;
  }
  std::string GetString() {
    const auto size = Size(1);
    std::string text(size, '\0');
    GetRaw(text.data(), size);
    return text;
  }
  template <class T>
  requires std::is_trivially_copyable_v<T> std::vector<T> GetVector() {
    const auto size = Size(sizeof(T));
    std::vector<T> values(size);
    if (size > 0) GetRaw(values.data(), size * sizeof(T));
    return values;
  }
  bool AtEnd() const { return rest_.empty(); }
  std::size_t Remaining() const { return rest_.size(); }

 private:
  std::size_t Size(std::size_t element_size) {
    const auto count = Get<std::uint64_t>();
    if (count > rest_.size() / element_size) throw Error(ErrorCode::kInvalidInput, "", "data ends too early");
    return static_cast<std::size_t>(count);
  }
  void GetRaw(void* target, std::size_t size) {
    if (size > rest_.size()) throw Error(ErrorCode::kInvalidInput, "", "data ends too early");
    std::memcpy(target, rest_.data(), size);
    rest_ = rest_.subspan(size);
  }
  std::span<const std::byte> rest_;
};

}  // namespace rilievo
