// Decodes the photographs of a folder to grey (and RGB) pixels.
#include "stages/images/decode.h"

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <utility>

#include "base/error.h"
#include "block/io/text.h"

namespace rilievo::images {
namespace {

constexpr char kHint[] = "copy or export the image again";

/// Rounded BT.601 luma in 14-bit fixed point.
template <class T>
T Luma(unsigned r, unsigned g, unsigned b) {
  return static_cast<T>((4899U * r + 9617U * g + 1868U * b + 8192U) >> 14);
}

template <class T>
void Convert(const cv::Mat& pixels, bool with_color, std::vector<T>& grey, std::vector<std::uint8_t>& rgb) {
  const auto count = static_cast<std::size_t>(pixels.rows) * static_cast<std::size_t>(pixels.cols);
  const int channels = pixels.channels();
  grey.resize(count);
  if (with_color) rgb.resize(3 * count);
  const auto to_byte = [](unsigned v) {
    return static_cast<std::uint8_t>(sizeof(T) == 1 ? v : (v * 255U + 32767U) / 65535U);
  };
  for (int y = 0; y < pixels.rows; ++y) {
    const T* row = pixels.ptr<T>(y);
    for (int x = 0; x < pixels.cols; ++x, row += channels) {
      const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(pixels.cols) + static_cast<std::size_t>(x);
      const unsigned r = row[channels >= 3 ? 2 : 0], g = row[channels >= 3 ? 1 : 0], b = row[0];
      grey[i] = channels >= 3 ? Luma<T>(r, g, b) : row[0];
      if (with_color) rgb[3 * i] = to_byte(r), rgb[3 * i + 1] = to_byte(g), rgb[3 * i + 2] = to_byte(b);
    }
  }
}

/// True when the scans of a JPEG end with the end-of-image marker; decoders fill what is missing with grey.
bool IsCompleteJpeg(std::string_view data) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(data[i]); };
  std::size_t at = 2;
  while (at + 4 <= data.size()) {
    if (byte(at) != 0xFF) return false;
    const unsigned marker = byte(at + 1);
    if (marker == 0xFF) {
      ++at;
      continue;
    }
    at += 2 + (byte(at + 2) << 8 | byte(at + 3));
    if (marker != 0xDA) continue;
    for (; at + 1 < data.size();
         ++at) {  // entropy-coded data up to the next marker that is neither a restart nor stuffing
      if (byte(at) != 0xFF) continue;
      const unsigned next = byte(at + 1);
      if (next == 0xD9) return true;
      if (next != 0 && next != 0xFF && (next < 0xD0 || next > 0xD7)) break;
    }
  }
  return false;
}

}  // namespace

GreyImage FolderPixelSource::Load(const std::string& image_name, bool with_color) const {
  const std::filesystem::path path = folder_ / image_name;
  const std::string data = io::ReadWholeFile(path);
  if (data.empty()) throw Error(ErrorCode::kInvalidInput, path.string(), "empty file (0 bytes)", kHint);
  if (data.starts_with("\xFF\xD8") && !IsCompleteJpeg(data))
    throw Error(ErrorCode::kInvalidInput, path.string(), "truncated: the JPEG ends before its last row", kHint);
  const cv::Mat bytes(1, static_cast<int>(data.size()), CV_8U, const_cast<char*>(data.data()));
  cv::Mat pixels;
  try {
    pixels = cv::imdecode(bytes, cv::IMREAD_ANYDEPTH | cv::IMREAD_ANYCOLOR | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception&) {
    pixels.release();
  }
  if (pixels.empty())
    throw Error(ErrorCode::kInvalidInput, path.string(), "cannot be decoded: corrupt or truncated image", kHint);
  GreyImage image;
  image.width_px = pixels.cols;
  image.height_px = pixels.rows;
  if (pixels.depth() == CV_8U)
    Convert(pixels, with_color, image.u8, image.rgb);
  else if (pixels.depth() == CV_16U)
    Convert(pixels, with_color, image.u16, image.rgb);
  else
    throw Error(ErrorCode::kUnsupported, path.string(), "samples are not 8 or 16 bit",
                "convert it to 8 or 16 bit grey or RGB");
  return image;
}

std::uint64_t FolderPixelSource::LoadPeakBytes(int width_px, int height_px, int channels, int bits_per_sample) const {
  const auto pixels = static_cast<std::uint64_t>(width_px) * static_cast<std::uint64_t>(height_px);
  const std::uint64_t sample = bits_per_sample > 8 ? 2 : 1, all = static_cast<std::uint64_t>(channels) * sample;
  return pixels * (sample + 3 + 3 * all) + (std::uint64_t{16} << 20);
}

}  // namespace rilievo::images
