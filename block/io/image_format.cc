// The containers JPEG, PNG and TIFF as far as their headers go: size, samples and where the EXIF block lies.
// Sources: ITU-T T.81 annex B (JPEG), PNG specification third edition (chunks), TIFF revision 6.0 and the BigTIFF
// proposal.
#include "block/io/image_format.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <span>
#include <string>
#include <utility>

#include "base/error.h"

namespace rilievo::io {
namespace {

/// Random access to a file that knows its length: every read is checked.
class HeaderFile {
 public:
  explicit HeaderFile(const std::filesystem::path& path)
      : path_(path.string()), file_(std::fopen(path.c_str(), "rb"), &std::fclose) {
    if (!file_) {
      const int reason = errno;
      throw Error(reason == ENOENT ? ErrorCode::kNotFound : ErrorCode::kUnreadable, path_,
                  std::string("cannot be opened: ") + std::strerror(reason), "check the path and its permissions");
    }
    std::error_code ec;
    size_ = std::filesystem::file_size(path, ec);
    if (ec) throw Error(ErrorCode::kUnreadable, path_, "is not a file", "check the path");
    if (size_ == 0) throw Error(ErrorCode::kInvalidInput, path_, "empty file (0 bytes)", "copy the image again");
  }
  std::uint64_t size() const { return size_; }

  Error Bad(const std::string& message) const {
    return {ErrorCode::kInvalidInput, path_, message, "copy or export the image again"};
  }
  Error Unsupported(const std::string& message) const {
    return {ErrorCode::kUnsupported, path_, message, "convert it to 8 or 16 bit grey or RGB"};
  }

  void Read(std::uint64_t offset, std::span<std::uint8_t> target) const {
    if (offset > size_ || target.size() > size_ - offset) throw Bad("truncated: the file ends inside its header");
    if (::fseeko(file_.get(), static_cast<off_t>(offset), SEEK_SET) != 0 ||
        std::fread(target.data(), 1, target.size(), file_.get()) != target.size())
      throw Error(ErrorCode::kUnreadable, path_, std::string("cannot be read: ") + std::strerror(errno),
                  "check the disk");
  }

 private:
  std::string path_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_;
  std::uint64_t size_ = 0;
};

/// An unsigned number of `Bytes` bytes at the front of `data`.
std::uint64_t Number(std::span<const std::uint8_t> data, int bytes, bool big_endian) {
  std::uint64_t value = 0;
  for (int i = 0; i < bytes; ++i) value = value << 8 | data[static_cast<std::size_t>(big_endian ? i : bytes - 1 - i)];
  return value;
}

std::uint64_t ReadNumber(const HeaderFile& file, std::uint64_t offset, int bytes, bool big_endian) {
  std::array<std::uint8_t, 8> data;
  file.Read(offset, std::span(data).first(static_cast<std::size_t>(bytes)));
  return Number(data, bytes, big_endian);
}

/// What a header says, the bytes there are for pixels, and the fewest that its format needs for that many. Sums in
/// double: sizes here may still be nonsense.
struct ParsedHeader {
  FormatHeader header;
  double pixel_bytes = 0, least_bytes = 0;
};

double PixelCount(const FormatHeader& header) {
  return static_cast<double>(header.width_px) * static_cast<double>(header.height_px);
}

constexpr double kMostByDeflate = 1032;  ///< RFC 1951: 258 bytes by a length and a distance code of 1 bit each

/// Sampling factors of the components of a JPEG frame (T.81, B.2.2).
struct JpegSampling {
  struct Factors {
    std::uint64_t horizontal = 1, vertical = 1;
  };
  std::vector<Factors> components;
  std::uint64_t widest = 1, highest = 1;
};

JpegSampling ReadJpegSampling(const HeaderFile& file, std::uint64_t at, int channels) {
  JpegSampling sampling;
  for (int i = 0; i < channels; ++i) {
    const auto factors = ReadNumber(file, at + 3 * static_cast<std::uint64_t>(i) + 1, 1, true);
    const std::uint64_t horizontal = factors >> 4, vertical = factors & 15;
    if (horizontal < 1 || horizontal > 4 || vertical < 1 || vertical > 4)
      throw file.Bad("corrupt JPEG header: impossible sampling factors");
    sampling.components.push_back({horizontal, vertical});
    sampling.widest = std::max(sampling.widest, horizontal);
    sampling.highest = std::max(sampling.highest, vertical);
  }
  return sampling;
}

/// The least that Huffman-coded JPEG takes for a frame: in a sequential file every 8x8 block has a DC code and an end
/// of block of 1 bit each (T.81, F.1.2), in a progressive one the DC code alone (G.1.2: one code may end 32767 blocks).
/// Counted for the most finely sampled component only.
double LeastJpegBytes(const FormatHeader& header, const JpegSampling& sampling, bool is_progressive) {
  std::uint64_t finest = 0;
  for (const auto& [horizontal, vertical] : sampling.components) finest = std::max(finest, horizontal * vertical);
  const double blocks =
      PixelCount(header) / 64 * static_cast<double>(finest) / static_cast<double>(sampling.widest * sampling.highest);
  return blocks * (is_progressive ? 1 : 2) / 8;
}

/// Whether the first scan behind `at` holds every component, so that rows can be decoded as they come. A file that ends
/// before says no.
bool FirstScanHoldsAll(const HeaderFile& file, std::uint64_t at, int channels) {
  while (at + 5 <= file.size() && ReadNumber(file, at, 1, true) == 0xFF) {
    const auto marker = ReadNumber(file, at + 1, 1, true);
    if (marker == 0xFF) {  // fill byte
      ++at;
      continue;
    }
    if (marker == 0xDA) return ReadNumber(file, at + 4, 1, true) == static_cast<std::uint64_t>(channels);
    at += 2 + ReadNumber(file, at + 2, 2, true);
  }
  return false;
}

constexpr std::uint64_t kDecoderBytes = 1 << 20;  ///< a decoder's tables and file buffers

/// Rows: at most 2 x 10 row groups of the tallest component before upsampling, one after it, one of colour. A file of
/// several scans needs all coefficients: 2 bytes a sample of each component's own size, in whole blocks.
std::uint64_t JpegScratchBytes(const FormatHeader& header, const JpegSampling& sampling, bool has_one_scan) {
  const auto width = static_cast<std::uint64_t>(header.width_px), height = static_cast<std::uint64_t>(header.height_px);
  std::uint64_t bytes = kDecoderBytes + (width + 64) * 64 * sampling.components.size();
  if (has_one_scan) return bytes;
  for (const auto& [horizontal, vertical] : sampling.components) {
    const auto blocks = [](std::uint64_t size, std::uint64_t factor, std::uint64_t most) {
      const std::uint64_t count = (size * factor + most * 8 - 1) / (most * 8);
      return (count + factor - 1) / factor * factor;
    };
    bytes += blocks(width, horizontal, sampling.widest) * blocks(height, vertical, sampling.highest) * 64 * 2;
  }
  return bytes;
}

ParsedHeader ReadJpeg(const HeaderFile& file) {
  static constexpr std::array<std::uint8_t, 6> kExif{'E', 'x', 'i', 'f', 0, 0};
  FormatHeader header;
  for (std::uint64_t at = 2;;) {
    if (ReadNumber(file, at, 1, true) != 0xFF) throw file.Bad("corrupt JPEG header: no marker where one must be");
    const auto marker = ReadNumber(file, at + 1, 1, true);
    if (marker == 0xFF) {  // fill byte
      ++at;
      continue;
    }
    if (marker == 0xD9 || marker == 0xDA) throw file.Bad("corrupt JPEG header: pixels come before the image size");
    const auto length = ReadNumber(file, at + 2, 2, true);
    if (length < 2) throw file.Bad("corrupt JPEG header: impossible segment length");
    if (marker == 0xE1 && length >= 2 + kExif.size() && header.exif.empty()) {
      std::vector<std::uint8_t> segment(length - 2);
      file.Read(at + 4, segment);
      if (std::equal(kExif.begin(), kExif.end(), segment.begin()))
        header.exif.assign(segment.begin() + kExif.size(), segment.end());
    }
    const bool is_frame = marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
    if (is_frame) {
      const int precision = static_cast<int>(ReadNumber(file, at + 4, 1, true));
      header.height_px = static_cast<long long>(ReadNumber(file, at + 5, 2, true));
      header.width_px = static_cast<long long>(ReadNumber(file, at + 7, 2, true));
      header.channels = static_cast<int>(ReadNumber(file, at + 9, 1, true));
      header.bits_per_sample = precision;
      if (precision != 8) throw file.Unsupported(std::to_string(precision) + "-bit JPEG is not read");
      if (marker == 0xC3 || marker >= 0xC5)
        throw file.Unsupported("lossless, hierarchical or arithmetic JPEG is not read");
      if (header.channels == 4) throw file.Unsupported("CMYK JPEG is not read");
      if (header.channels != 1 && header.channels != 3)
        throw file.Bad("corrupt JPEG header: impossible number of channels");
      const JpegSampling sampling = ReadJpegSampling(file, at + 10, header.channels);
      const bool is_progressive = marker == 0xC2;
      header.decode_scratch_bytes = JpegScratchBytes(
          header, sampling, !is_progressive && FirstScanHoldsAll(file, at + 2 + length, header.channels));
      const double least_bytes = LeastJpegBytes(header, sampling, is_progressive);
      return {std::move(header), static_cast<double>(file.size()), least_bytes};
    }
    at += 2 + length;
  }
}

ParsedHeader ReadPng(const HeaderFile& file) {
  FormatHeader header;
  header.format = ImageFormat::kPng;
  std::array<std::uint8_t, 25> first;  // length, "IHDR", 13 bytes, CRC
  file.Read(8, first);
  if (std::memcmp(first.data() + 4, "IHDR", 4) != 0 || Number(first, 4, true) != 13)
    throw file.Bad("corrupt PNG header");
  const auto field = [&](std::size_t offset, int bytes) {
    return Number(std::span(first).subspan(8 + offset), bytes, true);
  };
  header.width_px = static_cast<long long>(field(0, 4));
  header.height_px = static_cast<long long>(field(4, 4));
  const auto depth = field(8, 1), color = field(9, 1);
  header.bits_per_sample = depth == 16 ? 16 : 8;
  header.channels = color == 0 ? 1 : color == 4 ? 2 : color == 6 ? 4 : 3;
  const bool plausible = (depth == 1 || depth == 2 || depth == 4 || depth == 8 || depth == 16) &&
                         (color == 0 || color == 2 || color == 3 || color == 4 || color == 6);
  if (!plausible) throw file.Bad("corrupt PNG header: impossible sample format");
  // Two rows of the file and one of samples, of 8 bytes a pixel at most.
  header.decode_scratch_bytes = kDecoderBytes + 24 * static_cast<std::uint64_t>(header.width_px);
  const int stored_channels = color == 3 ? 1 : header.channels;
  const double raw_bytes = PixelCount(header) * stored_channels * static_cast<double>(depth) / 8;
  return {header, static_cast<double>(file.size()), raw_bytes / kMostByDeflate};
}

struct TiffLayout {
  bool big_endian = false, big_tiff = false;
  int word() const { return big_tiff ? 8 : 4; }
  std::uint64_t ValueAt(std::uint64_t entry) const { return entry + 4 + static_cast<std::uint64_t>(word()); }
};

/// The numbers of one directory entry of type BYTE, SHORT, LONG or LONG8.
std::vector<std::uint64_t> TiffValues(const HeaderFile& file, std::uint64_t entry, const TiffLayout& layout) {
  const auto type = ReadNumber(file, entry + 2, 2, layout.big_endian);
  const int bytes = type == 1 ? 1 : type == 3 ? 2 : type == 4 ? 4 : type == 16 ? 8 : 0;
  if (bytes == 0) throw file.Bad("corrupt TIFF header: impossible type of a number");
  const auto count = ReadNumber(file, entry + 4, layout.word(), layout.big_endian);
  if (count > (1U << 22)) throw file.Bad("corrupt TIFF header: impossible number of values");
  const bool is_inline = count <= static_cast<std::uint64_t>(layout.word() / bytes);
  const std::uint64_t at =
      is_inline ? layout.ValueAt(entry) : ReadNumber(file, layout.ValueAt(entry), layout.word(), layout.big_endian);
  std::vector<std::uint8_t> raw(count * static_cast<std::uint64_t>(bytes));
  file.Read(at, raw);
  std::vector<std::uint64_t> values(count);
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = Number(std::span(raw).subspan(i * static_cast<std::size_t>(bytes)), bytes, layout.big_endian);
  if (values.empty()) throw file.Bad("corrupt TIFF header: a tag without value");
  return values;
}

/// The tags that matter here, of the first directory.
struct TiffTags {
  std::uint64_t width_px = 0, height_px = 0, channels = 1, photometric = 1, sample_format = 1, compression = 1,
                planar = 1, rows_per_strip = ~std::uint64_t{0};
  std::uint64_t tile_width_px = 0, tile_height_px = 0;  ///< 0: strips
  std::vector<std::uint64_t> bits{1}, offsets, byte_counts;
};

TiffTags ReadTiffTags(const HeaderFile& file, const TiffLayout& layout) {
  TiffTags tags;
  const std::uint64_t directory = ReadNumber(file, layout.big_tiff ? 8 : 4, layout.word(), layout.big_endian);
  const auto entries = ReadNumber(file, directory, layout.big_tiff ? 8 : 2, layout.big_endian);
  if (entries > 4096) throw file.Bad("corrupt TIFF header: impossible number of tags");
  for (std::uint64_t i = 0; i < entries; ++i) {
    const std::uint64_t entry = directory + (layout.big_tiff ? 8 : 2) + i * (layout.big_tiff ? 20 : 12);
    switch (ReadNumber(file, entry, 2, layout.big_endian)) {
      case 256:
        tags.width_px = TiffValues(file, entry, layout)[0];
        break;
      case 257:
        tags.height_px = TiffValues(file, entry, layout)[0];
        break;
      case 258:
        tags.bits = TiffValues(file, entry, layout);
        break;
      case 259:
        tags.compression = TiffValues(file, entry, layout)[0];
        break;
      case 262:
        tags.photometric = TiffValues(file, entry, layout)[0];
        break;
      case 277:
        tags.channels = TiffValues(file, entry, layout)[0];
        break;
      case 278:
        tags.rows_per_strip = TiffValues(file, entry, layout)[0];
        break;
      case 284:
        tags.planar = TiffValues(file, entry, layout)[0];
        break;
      case 322:
        tags.tile_width_px = TiffValues(file, entry, layout)[0];
        break;
      case 323:
        tags.tile_height_px = TiffValues(file, entry, layout)[0];
        break;
      case 339:
        tags.sample_format = TiffValues(file, entry, layout)[0];
        break;
      case 273:  // strips
      case 324:
        tags.offsets = TiffValues(file, entry, layout);
        break;
      case 279:
      case 325:
        tags.byte_counts = TiffValues(file, entry, layout);
        break;
      default:
        break;
    }
  }
  return tags;
}

/// The most bytes of pixels that a byte of a TIFF's strips can make; 0 = no bound is known.
double MostPerByteOfTiff(std::uint64_t compression) {
  switch (compression) {
    case 1:  // none
      return 1;
    case 5:  // LZW: 4096 codes of at least 9 bits; a code's string is at most a byte longer than one before
      return 4096.0 * 8 / 9;
    case 7:  // JPEG: a bit for 64 samples
      return 512;
    case 8:
    case 32946:
      return kMostByDeflate;
    case 32773:  // PackBits: 128 bytes by two
      return 64;
    case 34925:  // LZMA: 273 bytes by 14 decisions of at least log2(2048 / 2017) bits, about 7100
    case 50000:  // Zstandard: 128 KiB by a repeat block of 4 bytes
      return 32768;
    default:
      return 0;
  }
}

/// What libtiff holds for the strip or tile it is in: its bytes in the file, for each plane of its own; of tiles, of
/// YCbCr (given as 4 bytes a pixel) and of codecs that work on it as a whole also its pixels.
std::uint64_t TiffScratchBytes(const HeaderFile& file, const TiffTags& tags) {
  const std::uint64_t sample_bytes = tags.bits[0] / 8, samples = tags.photometric == 3 ? 1 : tags.channels;
  const bool is_tiled = tags.tile_width_px > 0;
  const std::uint64_t width = is_tiled ? tags.tile_width_px : tags.width_px;
  const std::uint64_t height = is_tiled ? tags.tile_height_px : std::min(tags.rows_per_strip, tags.height_px);
  if (width == 0 || height == 0 || width > static_cast<std::uint64_t>(kMaxImagePixels) / height)
    throw file.Bad("corrupt TIFF header: impossible size of a strip or tile");
  std::uint64_t stored = 0;
  for (const std::uint64_t bytes : tags.byte_counts) stored = std::max(stored, bytes == 0 ? file.size() : bytes);
  const std::uint64_t pixels = width * height, raw = pixels * samples * sample_bytes;
  std::uint64_t bytes = 2 * kDecoderBytes + 3 * tags.width_px * samples * sample_bytes;
  if (tags.compression != 1 || is_tiled) bytes += tags.planar == 2 ? samples * stored : stored;
  if (is_tiled) bytes += raw;
  if (tags.photometric == 6) bytes += 4 * pixels + raw + (tags.compression == 7 ? 0 : file.size());  // mapped
  if (tags.compression == 7) bytes += 64 * width * samples + 2 * (height > 64 ? raw : 0);
  if (tags.compression == 34925) bytes += std::uint64_t{80} << 20;  // the dictionary of LZMA's highest preset
  if (tags.compression == 50000) bytes += std::uint64_t{16} << 20;  // Zstandard's usual largest window
  if (tags.compression > 50000) bytes += 2 * raw;
  return bytes;
}

/// Strips may share bytes, and careless writers leave their lengths 0: what counts is the larger of strips and file.
/// Colours of YCbCr may be subsampled to next to nothing.
ParsedHeader WithTiffBytes(const HeaderFile& file, const TiffTags& tags, const FormatHeader& header) {
  double strips = 0;
  for (const std::uint64_t bytes : tags.byte_counts) strips += static_cast<double>(bytes);
  const double stored_channels = tags.photometric == 3 || tags.photometric == 6 ? 1 : header.channels;
  const double raw_bytes = PixelCount(header) * stored_channels * header.bits_per_sample / 8;
  const double most = MostPerByteOfTiff(tags.compression);
  return {header, std::max(strips, static_cast<double>(file.size())), most > 0 ? raw_bytes / most : 0};
}

ParsedHeader ReadTiff(const HeaderFile& file, bool big_endian) {
  const TiffLayout layout{big_endian, ReadNumber(file, 2, 2, big_endian) == 43};
  const TiffTags tags = ReadTiffTags(file, layout);
  FormatHeader header;
  header.format = ImageFormat::kTiff;
  header.width_px = static_cast<long long>(std::min<std::uint64_t>(tags.width_px, 1U << 31));
  header.height_px = static_cast<long long>(std::min<std::uint64_t>(tags.height_px, 1U << 31));
  header.bits_per_sample = static_cast<int>(std::min<std::uint64_t>(tags.bits[0], 1000));
  header.channels = tags.photometric == 3 ? 3 : static_cast<int>(std::min<std::uint64_t>(tags.channels, 1000));
  if (tags.sample_format != 1) throw file.Unsupported("TIFF of signed or floating point samples is not read");
  const bool equal_bits = std::all_of(tags.bits.begin(), tags.bits.end(), [&](auto b) { return b == tags.bits[0]; });
  if ((tags.bits[0] != 8 && tags.bits[0] != 16) || !equal_bits)
    throw file.Unsupported("TIFF of " + std::to_string(header.bits_per_sample) + " bits a sample is not read");
  if (tags.photometric == 5) throw file.Unsupported("CMYK TIFF is not read");
  // 0 and 1 grey, 2 RGB, 3 palette, 6 YCbCr
  if (tags.photometric > 3 && tags.photometric != 6)
    throw file.Unsupported("TIFF of colour kind " + std::to_string(tags.photometric) + " is not read");
  if (header.channels < 1 || header.channels > 4)
    throw file.Unsupported("TIFF of " + std::to_string(header.channels) + " channels is not read");
  if (tags.offsets.empty() || tags.offsets.size() != tags.byte_counts.size())
    throw file.Bad("corrupt TIFF header: no pixels");
  for (std::size_t i = 0; i < tags.offsets.size(); ++i)
    if (tags.offsets[i] > file.size() || tags.byte_counts[i] > file.size() - tags.offsets[i])
      throw file.Bad("truncated: the TIFF's pixels end after the file does");
  if (header.width_px > 0 && header.height_px > 0) header.decode_scratch_bytes = TiffScratchBytes(file, tags);
  return WithTiffBytes(file, tags, header);
}

ParsedHeader Parse(const HeaderFile& file, const std::filesystem::path& path) {
  static constexpr std::array<std::uint8_t, 8> kPngSignature{0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};
  std::array<std::uint8_t, 8> magic{};
  file.Read(0, std::span(magic).first(std::min<std::size_t>(file.size(), magic.size())));
  if (magic[0] == 0xFF && magic[1] == 0xD8) return ReadJpeg(file);
  if (magic == kPngSignature) return ReadPng(file);
  const bool little = magic[0] == 'I' && magic[1] == 'I' && (magic[2] == 42 || magic[2] == 43) && magic[3] == 0;
  const bool big = magic[0] == 'M' && magic[1] == 'M' && magic[2] == 0 && (magic[3] == 42 || magic[3] == 43);
  if (little || big) return ReadTiff(file, big);
  throw Error(ErrorCode::kInvalidInput, path.string(), "is named like an image but is no JPEG, PNG or TIFF",
              "remove it from the folder or export the image again");
}

}  // namespace

FormatHeader ReadFormatHeader(const std::filesystem::path& path) {
  const HeaderFile file(path);
  ParsedHeader parsed = Parse(file, path);
  const FormatHeader& header = parsed.header;
  const std::string size = std::to_string(header.width_px) + " x " + std::to_string(header.height_px) + " px";
  if (header.width_px <= 0 || header.height_px <= 0 || header.width_px > kMaxImagePixels / header.height_px)
    throw Error(ErrorCode::kInvalidInput, path.string(), "implausible image size " + size,
                "images have 1 to 500 million pixels; export the image again");
  if (parsed.pixel_bytes < std::floor(parsed.least_bytes))
    throw file.Bad("truncated or corrupt: its header says " + size + ", for which " + std::to_string(file.size()) +
                   " bytes cannot be enough");
  return std::move(parsed.header);
}

}  // namespace rilievo::io
