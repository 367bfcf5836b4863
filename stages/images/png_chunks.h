// Checks a PNG's chunks and hands on those that make pixels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <string>

namespace rilievo::images {

/// Verifies lengths and checksums of all chunks up to IEND: damage is found before a decoder meets it. Returns "" or
/// what is wrong. Reads the file once, some kilobytes at a time.
std::string CheckPngChunks(std::FILE* png);

/// The signature and the chunks IHDR, PLTE, IDAT and IEND of a PNG that was checked, one after another: profiles, texts
/// and transparency never reach a decoder.
class PixelChunkReader {
 public:
  explicit PixelChunkReader(std::FILE* png);
  /// Fills `target`; false when there are fewer bytes than that.
  bool Read(unsigned char* target, std::size_t size);

 private:
  bool NextChunk();
  std::FILE* png_;
  std::size_t pending_ = 8;  ///< bytes of the current chunk still to be handed on
  bool ended_ = false;
};

}  // namespace rilievo::images
