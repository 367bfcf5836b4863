// SHA-256 for content keys and XXH3 for checksums.
#pragma once

#include <array>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace rilievo {

struct Sha256Digest {
  std::array<std::uint8_t, 32> bytes{};
  /// 64 lower-case hexadecimal digits.
  std::string Hex() const;
  friend auto operator<=>(const Sha256Digest&, const Sha256Digest&) = default;
};

/// Incremental SHA-256. Every Add* writes a length prefix first, so that ("ab","c") and ("a","bc") differ.
class KeyHasher {
 public:
  KeyHasher();
  ~KeyHasher();
  KeyHasher(KeyHasher&&) noexcept;
  KeyHasher& operator=(KeyHasher&&) noexcept;
  KeyHasher& Add(std::string_view text);
  KeyHasher& Add(std::uint64_t number);
  KeyHasher& Add(double number);
  KeyHasher& Add(const Sha256Digest& digest);
  Sha256Digest Finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// SHA-256 of a file's bytes; throws Error(kNotFound / kUnreadable).
Sha256Digest HashFile(const std::filesystem::path& path);

/// XXH3 64-bit of a byte range: the checksum of artifacts.
std::uint64_t Checksum(std::span<const std::byte> bytes);

}  // namespace rilievo
