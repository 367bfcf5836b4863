// Decodes JPEG row by row with libjpeg, and knows when pixels are missing or damaged.
#include "stages/images/jpeg_decoder.h"

#include <algorithm>
#include <cerrno>
#include <csetjmp>
#include <cstdio>  // jpeglib.h needs it before
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include <jerror.h>
#include <jpeglib.h>

#include "base/error.h"
#include "stages/images/luma.h"

namespace rilievo::images {
namespace {

/// libjpeg reports errors by a call that must not return: it jumps back into the method of JpegReader that is running.
/// No method has an object with a destructor between the jump and its target.
struct ErrorState {
  jpeg_error_mgr base;  // first: libjpeg knows only this part
  std::jmp_buf jump;
  char message[JMSG_LENGTH_MAX];
  bool truncated, damaged;
};

ErrorState& StateOf(j_common_ptr info) { return *reinterpret_cast<ErrorState*>(info->err); }

void OnError(j_common_ptr info) {
  ErrorState& state = StateOf(info);
  state.base.format_message(info, state.message);
  std::longjmp(state.jump, 1);
}

/// Warnings of marker syntax leave the pixels whole; the others mean that pixels were invented.
void OnMessage(j_common_ptr info, int level) {
  if (level >= 0) return;  // trace
  ErrorState& state = StateOf(info);
  const int code = state.base.msg_code;
  if (code == JWRN_EXTRANEOUS_DATA || code == JWRN_ADOBE_XFORM || code == JWRN_JFIF_MAJOR ||
      code == JWRN_BOGUS_PROGRESSION)
    return;
  if (!state.damaged && !state.truncated) state.base.format_message(info, state.message);
  (code == JWRN_JPEG_EOF ? state.truncated : state.damaged) = true;
}

class JpegReader {
 public:
  JpegReader() {
    info_.err = jpeg_std_error(&errors_.base);
    errors_.base.error_exit = OnError;
    errors_.base.emit_message = OnMessage;
    errors_.message[0] = '\0';
    errors_.truncated = errors_.damaged = false;
    if (setjmp(errors_.jump) == 0) jpeg_create_decompress(&info_);
  }
  JpegReader(const JpegReader&) = delete;
  JpegReader& operator=(const JpegReader&) = delete;
  ~JpegReader() { jpeg_destroy_decompress(&info_); }

  bool Start(std::FILE* file, bool with_color) {
    if (setjmp(errors_.jump) != 0) return false;
    jpeg_stdio_src(&info_, file);
    jpeg_read_header(&info_, TRUE);
    if (info_.jpeg_color_space == JCS_YCbCr)
      info_.out_color_space = with_color ? JCS_YCbCr : JCS_GRAYSCALE;
    else
      info_.out_color_space = info_.jpeg_color_space == JCS_GRAYSCALE ? JCS_GRAYSCALE : JCS_RGB;
    info_.dct_method = JDCT_ISLOW;  // the exact integer transform: equal bytes on every machine
    jpeg_start_decompress(&info_);
    return !IsDamaged();
  }
  bool ReadRow(JSAMPLE* row) {
    if (setjmp(errors_.jump) != 0) return false;
    jpeg_read_scanlines(&info_, &row, 1);
    return !IsDamaged();
  }
  int width() const { return static_cast<int>(info_.output_width); }
  int height() const { return static_cast<int>(info_.output_height); }
  J_COLOR_SPACE color_space() const { return info_.out_color_space; }
  std::string Reason() const {
    return std::string(errors_.truncated ? "truncated JPEG: " : "corrupt JPEG: ") + errors_.message;
  }

 private:
  bool IsDamaged() const { return errors_.truncated || errors_.damaged; }
  jpeg_decompress_struct info_{};
  ErrorState errors_{};
};

std::uint8_t Clamp(int value) { return static_cast<std::uint8_t>(std::clamp(value, 0, 255)); }

/// JFIF 1.02: R = Y + 1.402 Cr', G = Y - 0.344136 Cb' - 0.714136 Cr', B = Y + 1.772 Cb', in 16-bit fixed point.
void FromYCbCr(const JSAMPLE* in, int width, std::uint8_t* grey, std::uint8_t* rgb) {
  for (int x = 0; x < width; ++x, in += 3, rgb += 3) {
    const int y = in[0] * 65536 + 32768, cb = in[1] - 128, cr = in[2] - 128;
    grey[x] = in[0];
    rgb[0] = Clamp((y + 91881 * cr) >> 16);
    rgb[1] = Clamp((y - 22554 * cb - 46802 * cr) >> 16);
    rgb[2] = Clamp((y + 116130 * cb) >> 16);
  }
}

void FromGrey(const std::uint8_t* grey, int width, std::uint8_t* rgb) {
  for (int x = 0; x < width; ++x, rgb += 3) rgb[0] = rgb[1] = rgb[2] = grey[x];
}

void FromRgb(const JSAMPLE* in, int width, std::uint8_t* grey, std::uint8_t* rgb) {
  for (int x = 0; x < width; ++x, in += 3) grey[x] = Luma<std::uint8_t>(in[0], in[1], in[2]);
  if (rgb != nullptr) std::copy_n(in - 3 * width, 3 * width, rgb);
}

}  // namespace

GreyImage DecodeJpeg(const std::filesystem::path& path, bool with_color) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"), &std::fclose);
  if (!file)
    throw Error(errno == ENOENT ? ErrorCode::kNotFound : ErrorCode::kUnreadable, path.string(),
                std::string("cannot be opened: ") + std::strerror(errno), "check the path and its permissions");
  JpegReader reader;
  const auto bad = [&] {
    return Error(ErrorCode::kInvalidInput, path.string(), reader.Reason(), "copy or export the image again");
  };
  if (!reader.Start(file.get(), with_color)) throw bad();
  GreyImage image;
  image.width_px = reader.width();
  image.height_px = reader.height();
  const auto width = static_cast<std::size_t>(reader.width()), height = static_cast<std::size_t>(reader.height());
  image.u8.resize(width * height);
  if (with_color) image.rgb.resize(3 * width * height);
  std::vector<JSAMPLE> row(3 * width);
  for (std::size_t y = 0; y < height; ++y) {
    std::uint8_t* grey = &image.u8[y * width];
    std::uint8_t* rgb = with_color ? &image.rgb[3 * y * width] : nullptr;
    const bool is_grey = reader.color_space() == JCS_GRAYSCALE;
    if (!reader.ReadRow(is_grey ? grey : row.data())) throw bad();
    if (reader.color_space() == JCS_YCbCr) FromYCbCr(row.data(), image.width_px, grey, rgb);
    if (reader.color_space() == JCS_RGB) FromRgb(row.data(), image.width_px, grey, rgb);
    if (is_grey && with_color) FromGrey(grey, image.width_px, rgb);
  }
  return image;
}

}  // namespace rilievo::images
