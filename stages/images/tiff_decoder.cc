// Decodes TIFF by rows, strips or tiles with libtiff. Source: TIFF revision 6.0; libtiff 4.5 manual.
#include "stages/images/tiff_decoder.h"

#include <tiffio.h>

#include <algorithm>
#include <bit>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "stages/images/store_pixels.h"

namespace rilievo::images {
namespace {

/// What libtiff does with the file's bytes: mapped, they count as memory of the process as they are touched.
enum class Access { kRead, kMap };

/// An open file that keeps libtiff's messages to itself.
class TiffFile {
 public:
  TiffFile(const std::filesystem::path& path, Access access) : path_(path.string()) {
    const std::unique_ptr<TIFFOpenOptions, void (*)(TIFFOpenOptions*)> options(TIFFOpenOptionsAlloc(),
                                                                               &TIFFOpenOptionsFree);
    TIFFOpenOptionsSetErrorHandlerExtR(options.get(), OnError, this);
    TIFFOpenOptionsSetWarningHandlerExtR(options.get(), OnWarning, this);
    file_ = TIFFOpenExt(path.c_str(), access == Access::kMap ? "r" : "rm", options.get());
    if (file_ == nullptr) throw Bad();
  }
  TiffFile(const TiffFile&) = delete;
  TiffFile& operator=(const TiffFile&) = delete;
  ~TiffFile() {
    if (file_ != nullptr) TIFFClose(file_);
  }
  TIFF* get() const { return file_; }
  std::uint32_t Tag(std::uint32_t tag) const {
    std::uint32_t value = 0;
    std::uint16_t half = 0;
    const bool is_long = tag == TIFFTAG_IMAGEWIDTH || tag == TIFFTAG_IMAGELENGTH || tag == TIFFTAG_TILEWIDTH ||
                         tag == TIFFTAG_TILELENGTH || tag == TIFFTAG_ROWSPERSTRIP;
    if (is_long) return TIFFGetFieldDefaulted(file_, tag, &value) == 1 ? value : 0;
    return TIFFGetFieldDefaulted(file_, tag, &half) == 1 ? half : 0;
  }
  /// From here on a warning of a codec means that pixels were invented: libjpeg goes on with grey where data end.
  void BeginPixels() { in_pixels_ = true; }
  void Require(bool is_good) const {
    if (!is_good || is_damaged_) throw Bad();
  }
  Error Bad() const {
    return {ErrorCode::kInvalidInput, path_, "truncated or corrupt TIFF" + (message_.empty() ? "" : ": " + message_),
            "copy or export the image again"};
  }
  Error Unsupported(const std::string& what) const {
    return {ErrorCode::kUnsupported, path_, what + " is not read", "convert it to 8 or 16 bit grey or RGB"};
  }

 private:
  static int OnError(TIFF*, void* user, const char*, const char* format, std::va_list arguments) {
    auto* self = static_cast<TiffFile*>(user);
    char text[300];
    std::vsnprintf(text, sizeof text, format, arguments);
    if (self->message_.empty()) self->message_ = text;
    return 1;  // handled
  }
  static int OnWarning(TIFF* file, void* user, const char* module, const char* format, std::va_list arguments) {
    auto* self = static_cast<TiffFile*>(user);
    if (self->in_pixels_) {
      self->is_damaged_ = true;
      OnError(file, user, module, format, arguments);
    }
    return 1;
  }
  std::string path_, message_;
  TIFF* file_ = nullptr;
  bool in_pixels_ = false, is_damaged_ = false;
};

/// What the tags say about the samples.
struct Layout {
  int width_px = 0, height_px = 0, samples = 1, bits = 8, photometric = 1, compression = 1;
  bool in_planes = false;
  int rows_per_strip = 0, tile_width_px = 0, tile_height_px = 0;
  bool IsPalette() const { return photometric == PHOTOMETRIC_PALETTE; }
  bool IsYCbCr() const { return photometric == PHOTOMETRIC_YCBCR; }
  bool IsColor() const { return photometric == PHOTOMETRIC_RGB || IsYCbCr() || IsPalette(); }
  /// Samples that are looked at, of every pixel.
  int used_samples() const { return IsPalette() ? 1 : IsColor() ? 3 : 1; }
  std::size_t sample_bytes() const { return static_cast<std::size_t>(bits) / 8; }
};

Layout ReadLayout(const TiffFile& file) {
  Layout layout;
  layout.width_px = static_cast<int>(file.Tag(TIFFTAG_IMAGEWIDTH));
  layout.height_px = static_cast<int>(file.Tag(TIFFTAG_IMAGELENGTH));
  layout.samples = static_cast<int>(file.Tag(TIFFTAG_SAMPLESPERPIXEL));
  layout.bits = static_cast<int>(file.Tag(TIFFTAG_BITSPERSAMPLE));
  layout.photometric = static_cast<int>(file.Tag(TIFFTAG_PHOTOMETRIC));
  layout.compression = static_cast<int>(file.Tag(TIFFTAG_COMPRESSION));
  layout.in_planes = file.Tag(TIFFTAG_PLANARCONFIG) == PLANARCONFIG_SEPARATE && layout.samples > 1;
  layout.rows_per_strip =
      static_cast<int>(std::min(file.Tag(TIFFTAG_ROWSPERSTRIP), static_cast<std::uint32_t>(layout.height_px)));
  if (TIFFIsTiled(file.get()) != 0) {
    layout.tile_width_px = static_cast<int>(file.Tag(TIFFTAG_TILEWIDTH));
    layout.tile_height_px = static_cast<int>(file.Tag(TIFFTAG_TILELENGTH));
  }
  if (layout.bits != 8 && (layout.bits != 16 || layout.IsPalette() || layout.IsYCbCr()))
    throw file.Unsupported("a TIFF of this kind with " + std::to_string(layout.bits) + " bits a sample");
  file.Require(layout.samples >= layout.used_samples() && layout.width_px > 0 && layout.height_px > 0);
  return layout;
}

/// The colours of a palette, 256 of three bytes.
using Palette = std::vector<std::uint8_t>;

Palette ReadPalette(const TiffFile& file) {
  std::uint16_t *red = nullptr, *green = nullptr, *blue = nullptr;
  file.Require(TIFFGetField(file.get(), TIFFTAG_COLORMAP, &red, &green, &blue) == 1);
  // Old writers filled 8 of the 16 bits.
  unsigned most = 0;
  for (int i = 0; i < 256; ++i) most = std::max({most, unsigned{red[i]}, unsigned{green[i]}, unsigned{blue[i]}});
  Palette palette;
  for (int i = 0; i < 256; ++i)
    for (const auto* channel : {red, green, blue})
      palette.push_back(static_cast<std::uint8_t>(most < 256 ? channel[i] : channel[i] >> 8));
  return palette;
}

/// Takes decoded samples into the image, as the colour kind demands.
template <class T>
class PixelSink {
 public:
  PixelSink(const TiffFile& file, const Layout& layout, bool with_color)
      : layout_(layout), image_(EmptyImage<T>(layout.width_px, layout.height_px, with_color)) {
    if (layout.IsPalette()) palette_ = ReadPalette(file);
  }
  /// `stride` samples a pixel at `samples`, which may be changed.
  void Take(T* samples, int stride, const PixelRun& run) {
    if (layout_.photometric == PHOTOMETRIC_MINISWHITE)
      for (int i = 0; i < run.count; ++i) samples[i * stride] = static_cast<T>(~samples[i * stride]);
    if (!layout_.IsPalette()) return StorePixels(samples, stride, layout_.IsColor(), run, image_);
    colors_.resize(3 * static_cast<std::size_t>(run.count));
    for (int i = 0; i < run.count; ++i)
      std::copy_n(&palette_[3 * std::size_t{static_cast<std::uint8_t>(samples[i * stride])}], 3,
                  &colors_[3 * static_cast<std::size_t>(i)]);
    StorePixels(colors_.data(), 3, true, run, image_);
  }
  GreyImage Finish() { return std::move(image_); }

 private:
  const Layout& layout_;
  Palette palette_;
  std::vector<T> colors_;
  GreyImage image_;
};

/// Weaves rows of planes into one of interleaved samples.
template <class T>
void Interleave(const T* plane, int count, int sample, int samples, T* target) {
  for (int i = 0; i < count; ++i) target[i * samples + sample] = plane[i];
}

/// The rows of one plane (or of all samples) of a TIFF in strips, from above.
class RowReader {
 public:
  RowReader(const std::filesystem::path& path, const Layout& layout, int plane)
      : file_(path, Access::kRead), layout_(layout), plane_(plane) {
    if (layout.compression == COMPRESSION_JPEG && layout.IsYCbCr())
      TIFFSetField(file_.get(), TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
    row_bytes_ = static_cast<std::size_t>(TIFFScanlineSize64(file_.get()));
    const std::size_t needed = static_cast<std::size_t>(layout.width_px) * layout.sample_bytes() *
                               static_cast<std::size_t>(layout.in_planes ? 1 : layout.samples);
    file_.Require(row_bytes_ >= needed);
    // A strip may be the whole image: without compression its rows can be read alone.
    std::uint16_t order = FILLORDER_MSB2LSB;
    TIFFGetFieldDefaulted(file_.get(), TIFFTAG_FILLORDER, &order);
    if (layout.compression == COMPRESSION_NONE && order == FILLORDER_MSB2LSB && row_bytes_ == needed)
      plain_.reset(std::fopen(path.c_str(), "rb"));
    file_.BeginPixels();
  }
  std::size_t row_bytes() const { return row_bytes_; }
  void Read(int y, void* target) {
    if (plain_)
      ReadPlain(y, target);
    else
      file_.Require(TIFFReadScanline(file_.get(), target, static_cast<std::uint32_t>(y),
                                     static_cast<std::uint16_t>(plane_)) == 1);
  }

 private:
  void ReadPlain(int y, void* target) {
    const auto strip = TIFFComputeStrip(file_.get(), static_cast<std::uint32_t>(y), static_cast<std::uint16_t>(plane_));
    const std::uint64_t begin = static_cast<std::uint64_t>(y % layout_.rows_per_strip) * row_bytes_;
    file_.Require(begin + row_bytes_ <= TIFFGetStrileByteCount(file_.get(), strip));
    const std::uint64_t at = TIFFGetStrileOffset(file_.get(), strip) + begin;
    if (at != position_) file_.Require(::fseeko(plain_.get(), static_cast<off_t>(at), SEEK_SET) == 0);
    file_.Require(std::fread(target, 1, row_bytes_, plain_.get()) == row_bytes_);
    position_ = at + row_bytes_;
    if (TIFFIsByteSwapped(file_.get()) != 0 && layout_.bits == 16)
      TIFFSwabArrayOfShort(static_cast<std::uint16_t*>(target), static_cast<tmsize_t>(row_bytes_ / 2));
  }

  struct Closer {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  TiffFile file_;
  const Layout& layout_;
  int plane_;
  std::size_t row_bytes_ = 0;
  std::unique_ptr<std::FILE, Closer> plain_;
  std::uint64_t position_ = ~std::uint64_t{0};
};

/// Each plane is read through a file of its own, so that none is decoded twice.
template <class T>
void ReadStrips(const std::filesystem::path& path, const Layout& layout, PixelSink<T>& sink) {
  const int planes = layout.in_planes ? layout.used_samples() : 1;
  std::vector<std::unique_ptr<RowReader>> readers;
  for (int plane = 0; plane < planes; ++plane) readers.push_back(std::make_unique<RowReader>(path, layout, plane));
  std::vector<T> row(readers[0]->row_bytes() / sizeof(T) + 1);
  std::vector<T> woven(planes > 1 ? static_cast<std::size_t>(layout.width_px) * static_cast<std::size_t>(planes) : 0);
  for (int y = 0; y < layout.height_px; ++y) {
    for (int plane = 0; plane < planes; ++plane) {
      readers[static_cast<std::size_t>(plane)]->Read(y, row.data());
      if (planes > 1) Interleave(row.data(), layout.width_px, plane, planes, woven.data());
    }
    sink.Take(planes > 1 ? woven.data() : row.data(), layout.in_planes ? planes : layout.samples,
              {0, y, layout.width_px, 1});
  }
}

template <class T>
void ReadTiles(TiffFile& file, const Layout& layout, PixelSink<T>& sink) {
  if (layout.compression == COMPRESSION_JPEG && layout.IsYCbCr())
    TIFFSetField(file.get(), TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
  const int planes = layout.in_planes ? layout.used_samples() : 1;
  const int stride = layout.in_planes ? planes : layout.samples;
  const auto tile_pixels =
      static_cast<std::size_t>(layout.tile_width_px) * static_cast<std::size_t>(layout.tile_height_px);
  std::vector<T> plane_tile(static_cast<std::size_t>(TIFFTileSize64(file.get())) / sizeof(T) + 1);
  file.Require(plane_tile.size() > tile_pixels * static_cast<std::size_t>(layout.in_planes ? 1 : layout.samples));
  std::vector<T> woven(planes > 1 ? tile_pixels * static_cast<std::size_t>(planes) : 0);
  std::vector<T>& tile = planes > 1 ? woven : plane_tile;
  file.BeginPixels();
  for (int y0 = 0; y0 < layout.height_px; y0 += layout.tile_height_px)
    for (int x0 = 0; x0 < layout.width_px; x0 += layout.tile_width_px) {
      for (int plane = 0; plane < planes; ++plane) {
        file.Require(TIFFReadTile(file.get(), plane_tile.data(), static_cast<std::uint32_t>(x0),
                                  static_cast<std::uint32_t>(y0), 0, static_cast<std::uint16_t>(plane)) >= 0);
        if (planes > 1) Interleave(plane_tile.data(), static_cast<int>(tile_pixels), plane, planes, woven.data());
      }
      const int rows = std::min(layout.tile_height_px, layout.height_px - y0);
      const int columns = std::min(layout.tile_width_px, layout.width_px - x0);
      for (int y = 0; y < rows; ++y)
        sink.Take(&tile[static_cast<std::size_t>(y) * static_cast<std::size_t>(layout.tile_width_px) *
                        static_cast<std::size_t>(stride)],
                  stride, {x0, y0 + y, columns, 1});
    }
}

/// YCbCr that is not JPEG, and old JPEG: libtiff's own conversion to 4 bytes a pixel, a strip or tile at a time, which
/// comes upside down.
void ReadConverted(TiffFile& file, const Layout& layout, PixelSink<std::uint8_t>& sink) {
  TIFFSetField(file.get(), TIFFTAG_ORIENTATION, std::uint16_t{ORIENTATION_TOPLEFT});
  const bool is_tiled = layout.tile_width_px > 0;
  const int width = is_tiled ? layout.tile_width_px : layout.width_px;
  const int height = is_tiled ? layout.tile_height_px : layout.rows_per_strip;
  std::vector<std::uint32_t> raster(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  std::vector<std::uint8_t> row(3 * static_cast<std::size_t>(width));
  file.BeginPixels();
  for (int y0 = 0; y0 < layout.height_px; y0 += height)
    for (int x0 = 0; x0 < layout.width_px; x0 += width) {
      const auto column = static_cast<std::uint32_t>(x0), line = static_cast<std::uint32_t>(y0);
      file.Require((is_tiled ? TIFFReadRGBATileExt(file.get(), column, line, raster.data(), 1)
                             : TIFFReadRGBAStripExt(file.get(), line, raster.data(), 1)) == 1);
      const int rows = std::min(height, layout.height_px - y0), columns = std::min(width, layout.width_px - x0);
      for (int y = 0; y < rows; ++y) {
        const int from_below = (is_tiled ? height : rows) - 1 - y;
        const std::uint32_t* pixels = &raster[static_cast<std::size_t>(from_below) * static_cast<std::size_t>(width)];
        for (int x = 0; x < columns; ++x) {
          const std::uint8_t rgb[] = {static_cast<std::uint8_t>(TIFFGetR(pixels[x])),
                                      static_cast<std::uint8_t>(TIFFGetG(pixels[x])),
                                      static_cast<std::uint8_t>(TIFFGetB(pixels[x]))};
          std::copy_n(rgb, 3, &row[3 * static_cast<std::size_t>(x)]);
        }
        sink.Take(row.data(), 3, {x0, y0 + y, columns, 1});
      }
    }
}

template <class T>
GreyImage ReadPixels(const std::filesystem::path& path, TiffFile& file, const Layout& layout, bool with_color) {
  PixelSink<T> sink(file, layout, with_color);
  if (layout.tile_width_px > 0)
    ReadTiles(file, layout, sink);
  else
    ReadStrips(path, layout, sink);
  return sink.Finish();
}

}  // namespace

GreyImage DecodeTiff(const std::filesystem::path& path, bool with_color) {
  TiffFile file(path, Access::kRead);
  const Layout layout = ReadLayout(file);
  if (layout.bits == 16) return ReadPixels<std::uint16_t>(path, file, layout, with_color);
  const bool is_jpeg = layout.compression == COMPRESSION_JPEG && !layout.in_planes;
  if (!layout.IsYCbCr() || is_jpeg) return ReadPixels<std::uint8_t>(path, file, layout, with_color);
  // Read without mapping, libtiff 4.5 refuses uncompressed tiles here: it takes its buffer for their length.
  TiffFile mapped(path, Access::kMap);
  PixelSink<std::uint8_t> sink(file, layout, with_color);
  ReadConverted(mapped, layout, sink);
  return sink.Finish();
}

}  // namespace rilievo::images
