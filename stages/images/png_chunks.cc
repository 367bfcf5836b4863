// Checks a PNG's chunks and hands on those that make pixels. Source: PNG specification, third edition, sections 5 and
// annex D.
#include "stages/images/png_chunks.h"

#include <algorithm>
#include <array>
#include <span>
#include <string_view>
#include <vector>

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

std::uint32_t UpdateCrc(std::uint32_t crc, std::span<const unsigned char> bytes) {
  for (const unsigned char byte : bytes) crc = kCrcTable[(crc ^ byte) & 0xFFU] ^ (crc >> 8);
  return crc;
}

std::uint32_t BigEndian(const unsigned char* bytes) {
  return std::uint32_t{bytes[0]} << 24 | std::uint32_t{bytes[1]} << 16 | std::uint32_t{bytes[2]} << 8 | bytes[3];
}

/// Length and type of a chunk.
using ChunkHead = std::array<unsigned char, 8>;

bool ReadHead(std::FILE* png, ChunkHead& head) { return std::fread(head.data(), 1, head.size(), png) == head.size(); }

std::string_view TypeOf(const ChunkHead& head) { return {reinterpret_cast<const char*>(head.data()) + 4, 4}; }

bool MakesPixels(std::string_view type) { return type == "IHDR" || type == "PLTE" || type == "IDAT" || type == "IEND"; }

}  // namespace

std::string CheckPngChunks(std::FILE* png) {
  constexpr char kCut[] = "truncated PNG: it ends inside a chunk";
  std::vector<unsigned char> buffer(1 << 16);
  if (std::fseek(png, 8, SEEK_SET) != 0) return kCut;
  for (;;) {
    ChunkHead head;
    if (!ReadHead(png, head)) return "truncated PNG: it ends before its last chunk";
    std::uint32_t crc = UpdateCrc(0xFFFFFFFFU, std::span(head).subspan(4));
    for (std::size_t left = BigEndian(head.data()); left > 0;) {
      const std::size_t part = std::min(left, buffer.size());
      if (std::fread(buffer.data(), 1, part, png) != part) return kCut;
      crc = UpdateCrc(crc, std::span(buffer).first(part));
      left -= part;
    }
    if (std::fread(buffer.data(), 1, 4, png) != 4) return kCut;
    if (~crc != BigEndian(buffer.data())) return "corrupt PNG: wrong checksum of a chunk";
    if (TypeOf(head) == "IEND") return {};
  }
}

PixelChunkReader::PixelChunkReader(std::FILE* png) : png_(png) { std::rewind(png); }

/// Moves to the next chunk that makes pixels.
bool PixelChunkReader::NextChunk() {
  for (ChunkHead head; !ended_ && ReadHead(png_, head);) {
    const long length = static_cast<long>(BigEndian(head.data()));
    if (MakesPixels(TypeOf(head))) {
      ended_ = TypeOf(head) == "IEND";
      pending_ = static_cast<std::size_t>(length) + 12;
      return std::fseek(png_, -8, SEEK_CUR) == 0;
    }
    if (std::fseek(png_, length + 4, SEEK_CUR) != 0) return false;
  }
  return false;
}

bool PixelChunkReader::Read(unsigned char* target, std::size_t size) {
  while (size > 0) {
    if (pending_ == 0 && !NextChunk()) return false;
    const std::size_t part = std::min(size, pending_);
    if (std::fread(target, 1, part, png_) != part) return false;
    target += part;
    size -= part;
    pending_ -= part;
  }
  return true;
}

}  // namespace rilievo::images
