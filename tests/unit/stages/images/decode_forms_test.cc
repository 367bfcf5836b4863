// Every form of TIFF and PNG: pixels against what was written through libtiff and libpng, and files cut short.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>
#include <tiffio.h>

#include <cmath>
#include <cstdio>
#include <functional>

#include <jpeglib.h>

#include "base/rng.h"
#include "stages/images/decode.h"
#include "tests/unit/block/io/scratch_folder.h"

namespace rilievo::images {
namespace {

constexpr int kWidth = 67, kHeight = 45;

/// Sample `s` of pixel (x, y), `bits` wide: smooth, so that codecs work, with noise, so that places cannot be
/// exchanged.
unsigned Sample(int x, int y, int s, int bits) {
  const unsigned noise = static_cast<unsigned>(Mix64(static_cast<std::uint64_t>((y * kWidth + x) * 4 + s)) % 13);
  const unsigned value = 3U * static_cast<unsigned>(x) + static_cast<unsigned>(y * (s + 1) / 2) + noise;
  return bits == 16 ? value * 233U + noise : std::min(value, 255U);
}

struct TiffForm {
  int samples = 1, bits = 8, photometric = PHOTOMETRIC_MINISBLACK, compression = COMPRESSION_NONE;
  int planar = PLANARCONFIG_CONTIG, rows_per_strip = 7, tile = 0, fill_order = FILLORDER_MSB2LSB;
  const char* mode = "w";
  std::string Text() const {
    return std::to_string(samples) + " samples of " + std::to_string(bits) + " bits, photometric " +
           std::to_string(photometric) + ", compression " + std::to_string(compression) + ", planar " +
           std::to_string(planar) + ", rows " + std::to_string(rows_per_strip) + ", tile " + std::to_string(tile) +
           ", mode " + mode;
  }
};

using SampleFunction = std::function<unsigned(int x, int y, int s)>;

class Writer {
 public:
  Writer(const std::filesystem::path& path, const TiffForm& form)
      : form_(form), file_(TIFFOpen(path.c_str(), form.mode)) {
    TIFFSetField(file_, TIFFTAG_IMAGEWIDTH, kWidth);
    TIFFSetField(file_, TIFFTAG_IMAGELENGTH, kHeight);
    TIFFSetField(file_, TIFFTAG_SAMPLESPERPIXEL, form.samples);
    TIFFSetField(file_, TIFFTAG_BITSPERSAMPLE, form.bits);
    TIFFSetField(file_, TIFFTAG_PHOTOMETRIC, form.photometric);
    TIFFSetField(file_, TIFFTAG_COMPRESSION, form.compression);
    TIFFSetField(file_, TIFFTAG_PLANARCONFIG, form.planar);
    TIFFSetField(file_, TIFFTAG_FILLORDER, form.fill_order);
    TIFFSetField(file_, TIFFTAG_ORIENTATION, ORIENTATION_LEFTBOT);  // to be ignored
    if (form.samples % 2 == 0) {
      const std::uint16_t extra = EXTRASAMPLE_UNASSALPHA;
      TIFFSetField(file_, TIFFTAG_EXTRASAMPLES, 1, &extra);
    }
    if (form.tile > 0) {
      TIFFSetField(file_, TIFFTAG_TILEWIDTH, form.tile);
      TIFFSetField(file_, TIFFTAG_TILELENGTH, form.tile / 2);
    } else {
      TIFFSetField(file_, TIFFTAG_ROWSPERSTRIP, form.rows_per_strip);
    }
    if (form.photometric == PHOTOMETRIC_YCBCR) {
      TIFFSetField(file_, TIFFTAG_YCBCRSUBSAMPLING, 1, 1);
      if (form.compression == COMPRESSION_JPEG) TIFFSetField(file_, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
    }
    if (form.compression == COMPRESSION_JPEG) TIFFSetField(file_, TIFFTAG_JPEGQUALITY, 98);
  }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;
  ~Writer() { TIFFClose(file_); }
  TIFF* get() const { return file_; }

  void WriteAll(const SampleFunction& value) {
    const int planes = form_.planar == PLANARCONFIG_SEPARATE ? form_.samples : 1;
    for (int plane = 0; plane < planes; ++plane) {
      if (form_.tile > 0)
        for (int y = 0; y < kHeight; y += form_.tile / 2)
          for (int x = 0; x < kWidth; x += form_.tile) {
            auto bytes = Bytes(x, y, form_.tile, form_.tile / 2, plane, planes, value);
            TIFFWriteTile(file_, bytes.data(), static_cast<unsigned>(x), static_cast<unsigned>(y), 0,
                          static_cast<std::uint16_t>(plane));
          }
      else
        for (int y = 0; y < kHeight; ++y) {
          auto bytes = Bytes(0, y, kWidth, 1, plane, planes, value);
          TIFFWriteScanline(file_, bytes.data(), static_cast<unsigned>(y), static_cast<std::uint16_t>(plane));
        }
    }
  }

 private:
  std::vector<std::uint8_t> Bytes(int x0, int y0, int width, int height, int plane, int planes,
                                  const SampleFunction& value) const {
    std::vector<std::uint8_t> bytes;
    for (int y = y0; y < y0 + height; ++y)
      for (int x = x0; x < x0 + width; ++x)
        for (int s = planes > 1 ? plane : 0; s < (planes > 1 ? plane + 1 : form_.samples); ++s) {
          const unsigned v = x < kWidth && y < kHeight ? value(x, y, s) : 0;
          bytes.push_back(static_cast<std::uint8_t>(v));
          if (form_.bits == 16) bytes.push_back(static_cast<std::uint8_t>(v >> 8));
        }
    return bytes;
  }
  TiffForm form_;
  TIFF* file_;
};

class DecodeForms : public testing::Test {
 protected:
  /// Compares with `expected` (r, g, b of the file's depth), grey of it, within `tolerance`.
  void Check(const std::string& name, int bits, double tolerance, const SampleFunction& expected) {
    const GreyImage both = source_.Load(name, true), grey = source_.Load(name, false);
    ASSERT_EQ(both.width_px, kWidth);
    ASSERT_EQ(both.height_px, kHeight);
    ASSERT_EQ(both.Is16Bit(), bits == 16);
    EXPECT_EQ(both.u8, grey.u8);
    EXPECT_EQ(both.u16, grey.u16);
    EXPECT_TRUE(grey.rgb.empty());
    double largest_grey = 0, largest_color = 0;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const auto at = static_cast<std::size_t>(y * kWidth + x);
        const double r = expected(x, y, 0), g = expected(x, y, 1), b = expected(x, y, 2);
        const double luma = 0.299 * r + 0.587 * g + 0.114 * b;
        largest_grey = std::max(largest_grey, std::abs(luma - (bits == 16 ? both.u16[at] : both.u8[at])));
        for (int s = 0; s < 3; ++s)
          largest_color = std::max(largest_color, std::abs(expected(x, y, s) / (bits == 16 ? 257.0 : 1.0) -
                                                           both.rgb[3 * at + static_cast<std::size_t>(s)]));
      }
    EXPECT_LE(largest_grey, (bits == 16 ? 3.0 : 0.6) + tolerance);
    EXPECT_LE(largest_color, (bits == 16 ? 0.51 : 0.0) + tolerance);
  }
  std::filesystem::path Path(const std::string& name) const { return scratch_.path() / name; }
  std::string Mistake(const std::string& name) {
    testing::internal::CaptureStderr();
    const std::string line = ErrorOf([&] { source_.Load(name, false); });
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << "a library talks";
    EXPECT_THAT(line, testing::HasSubstr(name));
    return line;
  }
  ScratchFolder scratch_;
  FolderPixelSource source_{scratch_.path()};
};

TEST_F(DecodeForms, LosslessTiff) {
  const auto layouts = {TiffForm{}, TiffForm{.rows_per_strip = kHeight}, TiffForm{.rows_per_strip = 7, .tile = 32}};
  for (const TiffForm& layout : layouts)
    for (const int compression : {COMPRESSION_NONE, COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE, COMPRESSION_PACKBITS})
      for (const int planar : {PLANARCONFIG_CONTIG, PLANARCONFIG_SEPARATE})
        for (const char* mode : {"wl", "wb", "w8"})
          for (const int bits : {8, 16})
            for (const int samples : {1, 2, 3, 4}) {
              TiffForm form = layout;
              form.compression = compression, form.planar = planar, form.mode = mode;
              form.bits = bits, form.samples = samples;
              form.photometric = samples >= 3 ? PHOTOMETRIC_RGB : PHOTOMETRIC_MINISBLACK;
              SCOPED_TRACE(form.Text());
              Writer(Path("a.tif"), form).WriteAll([&](int x, int y, int s) { return Sample(x, y, s, bits); });
              Check("a.tif", bits, 0, [&](int x, int y, int s) { return Sample(x, y, samples >= 3 ? s : 0, bits); });
              if (HasFailure()) return;
            }
}

TEST_F(DecodeForms, OtherKindsOfTiff) {
  for (const int bits : {8, 16}) {
    Writer(Path("white.tif"), {.bits = bits, .photometric = PHOTOMETRIC_MINISWHITE}).WriteAll([&](int x, int y, int) {
      return Sample(x, y, 0, bits);
    });
    Check("white.tif", bits, 0,
          [&](int x, int y, int) { return (bits == 16 ? 65535U : 255U) - Sample(x, y, 0, bits); });
  }
  for (const int tile : {0, 32})
    for (const unsigned scale : {1U, 257U}) {  // writers that fill 8 of the 16 bits
      {
        Writer writer(Path("palette.tif"), {.photometric = PHOTOMETRIC_PALETTE, .tile = tile});
        std::uint16_t map[3][256];
        for (unsigned i = 0; i < 256; ++i)
          for (unsigned s = 0; s < 3; ++s) map[s][i] = static_cast<std::uint16_t>(((i * (2 * s + 7)) & 255U) * scale);
        TIFFSetField(writer.get(), TIFFTAG_COLORMAP, map[0], map[1], map[2]);
        writer.WriteAll([&](int x, int y, int) { return Sample(x, y, 0, 8); });
      }
      Check("palette.tif", 8, 0,
            [&](int x, int y, int s) { return (Sample(x, y, 0, 8) * (2 * static_cast<unsigned>(s) + 7)) & 255U; });
    }
  Writer(Path("fill.tif"), {.fill_order = FILLORDER_LSB2MSB}).WriteAll([&](int x, int y, int) {
    return Sample(x, y, 0, 8);
  });
  Check("fill.tif", 8, 0, [&](int x, int y, int) { return Sample(x, y, 0, 8); });
}

TEST_F(DecodeForms, TiffOfLumaAndColorDifferences) {
  // Strips and tiles of 16 rows and more: JPEG has them in whole blocks.
  for (const int tile : {0, 32}) {
    SCOPED_TRACE(tile);
    const auto smooth = [](int x, int y, int s) {
      return static_cast<unsigned>(60 + x + 2 * y * (s == 1) + 40 * (s == 2));
    };
    Writer(Path("jpeg.tif"), {.samples = 3,
                              .photometric = PHOTOMETRIC_YCBCR,
                              .compression = COMPRESSION_JPEG,
                              .rows_per_strip = 16,
                              .tile = tile})
        .WriteAll(smooth);
    Check("jpeg.tif", 8, 6, smooth);
    const auto yuv = [](int x, int y, int s) {
      return static_cast<unsigned>(s == 0 ? 60 + x + y : s == 1 ? 100 + x / 2 : 150 - y / 2);
    };
    Writer(Path("plain.tif"), {.samples = 3, .photometric = PHOTOMETRIC_YCBCR, .rows_per_strip = 16, .tile = tile})
        .WriteAll(yuv);
    Check("plain.tif", 8, 2, [&](int x, int y, int s) {
      const double l = yuv(x, y, 0), cb = yuv(x, y, 1) - 128.0, cr = yuv(x, y, 2) - 128.0;
      const double value = s == 0 ? l + 1.402 * cr : s == 1 ? l - 0.344136 * cb - 0.714136 * cr : l + 1.772 * cb;
      return static_cast<unsigned>(std::clamp(value, 0.0, 255.0));
    });
  }
}

TEST_F(DecodeForms, StripsAndTilesThatEndTooEarlyAreSeen) {
  for (const int compression :
       {COMPRESSION_NONE, COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE, COMPRESSION_PACKBITS, COMPRESSION_JPEG})
    for (const int tile : {0, 32}) {
      // libtiff takes uncompressed tiles of unequal lengths for a careless writer's and computes the lengths itself.
      if (compression == COMPRESSION_NONE && tile > 0) continue;
      TiffForm form{.compression = compression, .rows_per_strip = 16, .tile = tile};
      SCOPED_TRACE(form.Text());
      Writer(Path("whole.tif"), form).WriteAll([&](int x, int y, int) { return Sample(x, y, 0, 8); });
      EXPECT_EQ(source_.Load("whole.tif", false).width_px, kWidth);
      {
        TIFF* whole = TIFFOpen(Path("whole.tif").c_str(), "r");
        Writer cut(Path("cut.tif"), form);
        std::uint32_t size = 0;
        void* tables = nullptr;
        if (compression == COMPRESSION_JPEG && TIFFGetField(whole, TIFFTAG_JPEGTABLES, &size, &tables) == 1)
          TIFFSetField(cut.get(), TIFFTAG_JPEGTABLES, size, tables);
        const auto count = tile > 0 ? TIFFNumberOfTiles(whole) : TIFFNumberOfStrips(whole);
        for (std::uint32_t i = 0; i < count; ++i) {
          std::vector<char> raw(1 << 16);
          const auto bytes = tile > 0 ? TIFFReadRawTile(whole, i, raw.data(), 1 << 16)
                                      : TIFFReadRawStrip(whole, i, raw.data(), 1 << 16);
          const auto kept = i == 1 ? bytes / 2 : bytes;
          if (tile > 0)
            TIFFWriteRawTile(cut.get(), i, raw.data(), kept);
          else
            TIFFWriteRawStrip(cut.get(), i, raw.data(), kept);
        }
        TIFFClose(whole);
      }
      EXPECT_THAT(Mistake("cut.tif"), testing::HasSubstr("truncated or corrupt"));
    }
}

TEST_F(DecodeForms, FourInksAreRefusedInOneLine) {
  for (const J_COLOR_SPACE space : {JCS_CMYK, JCS_YCCK}) {
    jpeg_compress_struct info{};
    jpeg_error_mgr errors{};
    info.err = jpeg_std_error(&errors);
    jpeg_create_compress(&info);
    std::FILE* file = std::fopen(Path("inks.jpg").c_str(), "wb");
    jpeg_stdio_dest(&info, file);
    info.image_width = kWidth, info.image_height = kHeight, info.input_components = 4;
    info.in_color_space = JCS_CMYK;
    jpeg_set_defaults(&info);
    jpeg_set_colorspace(&info, space);
    jpeg_start_compress(&info, TRUE);
    std::vector<JSAMPLE> samples(4 * kWidth, 90);
    for (int y = 0; y < kHeight; ++y) {
      JSAMPROW row = samples.data();
      jpeg_write_scanlines(&info, &row, 1);
    }
    jpeg_finish_compress(&info);
    jpeg_destroy_compress(&info);
    std::fclose(file);
    EXPECT_THAT(Mistake("inks.jpg"), testing::HasSubstr("CMYK JPEG is not read"));
  }
}

TEST_F(DecodeForms, EveryPng) {
  struct Form {
    int color, bits;
  };
  for (const Form& form :
       {Form{PNG_COLOR_TYPE_GRAY, 1}, Form{PNG_COLOR_TYPE_GRAY, 2}, Form{PNG_COLOR_TYPE_GRAY, 4},
        Form{PNG_COLOR_TYPE_GRAY, 8}, Form{PNG_COLOR_TYPE_GRAY, 16}, Form{PNG_COLOR_TYPE_PALETTE, 1},
        Form{PNG_COLOR_TYPE_PALETTE, 4}, Form{PNG_COLOR_TYPE_PALETTE, 8}, Form{PNG_COLOR_TYPE_RGB, 8},
        Form{PNG_COLOR_TYPE_RGB, 16}, Form{PNG_COLOR_TYPE_GRAY_ALPHA, 8}, Form{PNG_COLOR_TYPE_GRAY_ALPHA, 16},
        Form{PNG_COLOR_TYPE_RGBA, 8}, Form{PNG_COLOR_TYPE_RGBA, 16}})
    for (const int interlace : {PNG_INTERLACE_NONE, PNG_INTERLACE_ADAM7}) {
      SCOPED_TRACE("color " + std::to_string(form.color) + ", bits " + std::to_string(form.bits) + ", interlace " +
                   std::to_string(interlace));
      const int samples = form.color == PNG_COLOR_TYPE_RGBA         ? 4
                          : form.color == PNG_COLOR_TYPE_RGB        ? 3
                          : form.color == PNG_COLOR_TYPE_GRAY_ALPHA ? 2
                                                                    : 1;
      const unsigned mask = form.bits == 16 ? 65535U : (1U << form.bits) - 1;
      const auto value = [&](int x, int y, int s) { return Sample(x, y, s, form.bits) & mask; };
      const auto palette_color = [](unsigned i, int s) { return (i * (2 * static_cast<unsigned>(s) + 7) + 20) & 255U; };
      std::vector<std::vector<png_byte>> rows(kHeight);
      std::vector<png_bytep> pointers;
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x)
          for (int s = 0; s < samples; ++s) {
            if (form.bits == 16)
              rows[static_cast<std::size_t>(y)].push_back(static_cast<png_byte>(value(x, y, s) >> 8));
            rows[static_cast<std::size_t>(y)].push_back(static_cast<png_byte>(value(x, y, s)));
          }
        pointers.push_back(rows[static_cast<std::size_t>(y)].data());
      }
      {
        std::FILE* file = std::fopen(Path("a.png").c_str(), "wb");
        png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
        png_infop info = png_create_info_struct(png);
        png_init_io(png, file);
        png_set_IHDR(png, info, kWidth, kHeight, form.bits, form.color, interlace, PNG_COMPRESSION_TYPE_BASE,
                     PNG_FILTER_TYPE_BASE);
        std::vector<png_color> palette;
        for (unsigned i = 0; i <= std::min(mask, 255U); ++i)
          palette.push_back({static_cast<png_byte>(palette_color(i, 0)), static_cast<png_byte>(palette_color(i, 1)),
                             static_cast<png_byte>(palette_color(i, 2))});
        if (form.color == PNG_COLOR_TYPE_PALETTE) {
          png_set_PLTE(png, info, palette.data(), static_cast<int>(palette.size()));
          png_byte transparency[] = {0};
          png_set_tRNS(png, info, transparency, 1, nullptr);
        }
        png_set_gAMA(png, info, 1.0);  // to be ignored
        png_write_info(png, info);
        png_set_packing(png);
        png_write_image(png, pointers.data());
        png_write_end(png, info);
        png_destroy_write_struct(&png, &info);
        std::fclose(file);
      }
      const unsigned spread = form.bits < 8 ? 255U / mask : 1;
      Check("a.png", form.bits == 16 ? 16 : 8, 0, [&](int x, int y, int s) {
        if (form.color == PNG_COLOR_TYPE_PALETTE) return palette_color(value(x, y, 0), s);
        return value(x, y, samples >= 3 ? s : 0) * spread;
      });
      if (HasFailure()) return;
    }
}

}  // namespace
}  // namespace rilievo::images
