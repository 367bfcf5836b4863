// Decodes PNG row by row with libpng. Source: PNG specification, third edition; libpng 1.6 manual.
#include "stages/images/png_decoder.h"

#include <png.h>

#include <cerrno>
#include <csetjmp>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "stages/images/png_chunks.h"
#include "stages/images/store_pixels.h"

namespace rilievo::images {
namespace {

constexpr char kHint[] = "copy or export the image again";

/// libpng reports errors by a call that must not return: it jumps back into the method that is running. No method has
/// an object with a destructor between the jump and its target.
class PngReader {
 public:
  explicit PngReader(std::FILE* file) : chunks_(file) {
    message_[0] = '\0';
    png_ = png_create_read_struct(PNG_LIBPNG_VER_STRING, this, OnError, [](png_structp, png_const_charp) {});
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
  }
  PngReader(const PngReader&) = delete;
  PngReader& operator=(const PngReader&) = delete;
  ~PngReader() { png_destroy_read_struct(&png_, &info_, nullptr); }

  /// Samples come as 8 bits, or 16 in the machine's order; one channel or three.
  bool Start() {
    if (info_ == nullptr) return false;
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    png_set_read_fn(png_, this, OnRead);
    png_set_user_limits(png_, 0x7FFFFFFF, 0x7FFFFFFF);               // the header was checked
    png_set_crc_action(png_, PNG_CRC_QUIET_USE, PNG_CRC_QUIET_USE);  // and every chunk
    png_read_info(png_, info_);
    if (png_get_color_type(png_, info_) == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(png_);
    if (png_get_color_type(png_, info_) == PNG_COLOR_TYPE_GRAY) png_set_expand_gray_1_2_4_to_8(png_);
    png_set_strip_alpha(png_);
    if (png_get_bit_depth(png_, info_) == 16) png_set_swap(png_);
    png_read_update_info(png_, info_);
    return true;
  }
  /// The next row: of an interlaced file that of its pass, without gaps.
  bool ReadRow(png_bytep row) {
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    png_read_row(png_, row, nullptr);
    return true;
  }
  int width() const { return static_cast<int>(png_get_image_width(png_, info_)); }
  int height() const { return static_cast<int>(png_get_image_height(png_, info_)); }
  int channels() const { return png_get_channels(png_, info_); }
  bool Is16Bit() const { return png_get_bit_depth(png_, info_) == 16; }
  bool IsInterlaced() const { return png_get_interlace_type(png_, info_) == PNG_INTERLACE_ADAM7; }
  std::size_t row_bytes() const { return png_get_rowbytes(png_, info_); }
  std::string Reason() const { return std::string("corrupt PNG: ") + message_; }

 private:
  static void OnError(png_structp png, png_const_charp message) {
    auto* self = static_cast<PngReader*>(png_get_error_ptr(png));
    std::snprintf(self->message_, sizeof self->message_, "%s", message);
    png_longjmp(png, 1);
  }
  static void OnRead(png_structp png, png_bytep target, std::size_t size) {
    if (!static_cast<PngReader*>(png_get_io_ptr(png))->chunks_.Read(target, size))
      png_error(png, "it has too few pixels");
  }
  PixelChunkReader chunks_;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
  char message_[256];
};

/// Throws Error for a row that cannot be read.
template <class T>
GreyImage ReadPixels(PngReader& reader, bool with_color, const std::string& path) {
  GreyImage image = EmptyImage<T>(reader.width(), reader.height(), with_color);
  std::vector<T> row(reader.row_bytes() / sizeof(T));
  const auto read = [&](const PixelRun& run) {
    if (!reader.ReadRow(reinterpret_cast<png_bytep>(row.data())))
      throw Error(ErrorCode::kInvalidInput, path, reader.Reason(), kHint);
    StorePixels(row.data(), reader.channels(), reader.channels() >= 3, run, image);
  };
  if (!reader.IsInterlaced()) {
    for (int y = 0; y < image.height_px; ++y) read({0, y, image.width_px, 1});
    return image;
  }
  for (int pass = 0; pass < PNG_INTERLACE_ADAM7_PASSES; ++pass) {
    const int columns = static_cast<int>(PNG_PASS_COLS(static_cast<unsigned>(image.width_px), pass));
    const int rows = static_cast<int>(PNG_PASS_ROWS(static_cast<unsigned>(image.height_px), pass));
    for (int y = 0; columns > 0 && y < rows; ++y)
      read({static_cast<int>(PNG_COL_FROM_PASS_COL(0, pass)),
            static_cast<int>(PNG_ROW_FROM_PASS_ROW(static_cast<unsigned>(y), pass)), columns,
            1 << PNG_PASS_COL_SHIFT(pass)});
  }
  return image;
}

}  // namespace

GreyImage DecodePng(const std::filesystem::path& path, bool with_color) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"), &std::fclose);
  if (!file)
    throw Error(errno == ENOENT ? ErrorCode::kNotFound : ErrorCode::kUnreadable, path.string(),
                std::string("cannot be opened: ") + std::strerror(errno), "check the path and its permissions");
  if (const std::string wrong = CheckPngChunks(file.get()); !wrong.empty())
    throw Error(ErrorCode::kInvalidInput, path.string(), wrong, kHint);
  PngReader reader(file.get());
  if (!reader.Start()) throw Error(ErrorCode::kInvalidInput, path.string(), reader.Reason(), kHint);
  return reader.Is16Bit() ? ReadPixels<std::uint16_t>(reader, with_color, path.string())
                          : ReadPixels<std::uint8_t>(reader, with_color, path.string());
}

}  // namespace rilievo::images
