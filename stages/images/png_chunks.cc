// Checks a PNG's chunks and keeps those that make pixels. Source: PNG specification, third edition, sections 5 and
// annex D.
#include "stages/images/png_chunks.h"

#include <array>
#include <cstdint>
#include <cstring>

namespace rilievo::images {
namespace {

/// The CRC of annex D, eight bits at a time.
constexpr std::array<std::uint32_t, 256> kCrcTable = [] {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t n = 0; n < 256; ++n) {
    std::uint32_t c = n;
    for (int k = 0; k < 8; ++k) c = (c & 1U) != 0 ? 0xEDB88320U ^ (c >> 1) : c >> 1;
    table[n] = c;
  }
  return table;
}();

std::uint32_t Crc(std::string_view bytes) {
  std::uint32_t c = 0xFFFFFFFFU;
  for (const char byte : bytes) c = kCrcTable[(c ^ static_cast<unsigned char>(byte)) & 0xFFU] ^ (c >> 8);
  return ~c;
}

std::uint32_t BigEndian(std::string_view bytes) {
  std::uint32_t value = 0;
  for (const char byte : bytes.substr(0, 4)) value = value << 8 | static_cast<unsigned char>(byte);
  return value;
}

}  // namespace

std::string KeepPixelChunks(std::string& png) {
  std::size_t kept = 8;  // the signature
  for (std::size_t at = 8;;) {
    const std::string_view rest = std::string_view(png).substr(at);
    if (rest.size() < 12) return "truncated PNG: it ends before its last chunk";
    const std::size_t length = BigEndian(rest);
    if (length > rest.size() - 12) return "truncated PNG: it ends inside a chunk";
    const std::string type(rest.substr(4, 4));
    if (Crc(rest.substr(4, 4 + length)) != BigEndian(rest.substr(8 + length)))
      return "corrupt PNG: wrong checksum of a chunk";
    if (type == "IHDR" || type == "PLTE" || type == "IDAT" || type == "IEND") {
      std::memmove(png.data() + kept, png.data() + at, length + 12);
      kept += length + 12;
    }
    at += length + 12;
    if (type == "IEND") break;
  }
  png.resize(kept);
  return {};
}

}  // namespace rilievo::images
