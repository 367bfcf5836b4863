// Decodes the photographs of a folder to grey (and RGB) pixels.
#include "stages/images/decode.h"

#include <algorithm>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <utility>

#include "base/error.h"
#include "block/io/image_format.h"
#include "block/io/text.h"
#include "stages/images/jpeg_decoder.h"
#include "stages/images/luma.h"
#include "stages/images/png_chunks.h"

namespace rilievo::images {
namespace {

constexpr char kHint[] = "copy or export the image again";
constexpr std::uint64_t kSlackBytes = std::uint64_t{16} << 20;

/// Largest PNG or TIFF file: one and a half times its raw pixels leaves room for previews and overviews.
std::uint64_t MaxFileBytes(std::uint64_t raw_bytes) { return raw_bytes + raw_bytes / 2 + kSlackBytes; }

template <class T>
void Convert(const cv::Mat& pixels, bool with_color, std::vector<T>& grey, std::vector<std::uint8_t>& rgb) {
  const auto count = static_cast<std::size_t>(pixels.rows) * static_cast<std::size_t>(pixels.cols);
  const int channels = pixels.channels();
  grey.resize(count);
  if (with_color) rgb.resize(3 * count);
  const auto to_byte = [](unsigned v) {
    return static_cast<std::uint8_t>(sizeof(T) == 1 ? v : (v * 255U + 32767U) / 65535U);
  };
  std::size_t i = 0;
  for (int y = 0; y < pixels.rows; ++y) {
    const T* row = pixels.ptr<T>(y);
    for (int x = 0; x < pixels.cols; ++x, ++i, row += channels) {
      const unsigned r = row[channels >= 3 ? 2 : 0], g = row[channels >= 3 ? 1 : 0], b = row[0];
      grey[i] = channels >= 3 ? Luma<T>(r, g, b) : row[0];
      if (with_color) rgb[3 * i] = to_byte(r), rgb[3 * i + 1] = to_byte(g), rgb[3 * i + 2] = to_byte(b);
    }
  }
}

/// PNG and TIFF as OpenCV reads them, from bytes in which nothing is left that it would print about or turn the image
/// by.
cv::Mat DecodeOther(const std::filesystem::path& path, const io::FormatHeader& header) {
  const auto raw_bytes = static_cast<std::uint64_t>(header.width_px) * static_cast<std::uint64_t>(header.height_px) *
                         static_cast<std::uint64_t>(header.channels * header.bits_per_sample / 8);
  std::string data = io::ReadWholeFile(path, MaxFileBytes(raw_bytes));
  if (header.format == io::ImageFormat::kPng) {
    if (const std::string wrong = KeepPixelChunks(data); !wrong.empty())
      throw Error(ErrorCode::kInvalidInput, path.string(), wrong, kHint);
  } else if (const auto at = header.tiff_orientation_at; at != 0 && at + 2 <= data.size()) {
    data[at] = static_cast<char>(header.is_big_endian ? 0 : 1);
    data[at + 1] = static_cast<char>(header.is_big_endian ? 1 : 0);
  }
  const std::size_t max_array = std::numeric_limits<int>::max();
  if (data.size() > max_array)
    throw Error(ErrorCode::kUnsupported, path.string(), "files above 2 GiB are not read", "save it compressed");
  const cv::Mat bytes(1, static_cast<int>(data.size()), CV_8U, data.data());
  cv::Mat pixels;
  try {
    pixels = cv::imdecode(bytes, cv::IMREAD_ANYDEPTH | cv::IMREAD_ANYCOLOR | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception&) {
    pixels.release();
  }
  if (pixels.empty())
    throw Error(ErrorCode::kInvalidInput, path.string(),
                "cannot be decoded: corrupt, truncated or of a kind that is not read", kHint);
  return pixels;
}

}  // namespace

GreyImage FolderPixelSource::Load(const std::string& image_name, bool with_color) const {
  const std::filesystem::path path = folder_ / image_name;
  const io::FormatHeader header = io::ReadFormatHeader(path);
  if (header.format == io::ImageFormat::kJpeg) return DecodeJpeg(path, with_color);
  const cv::Mat pixels = DecodeOther(path, header);
  if (pixels.cols != header.width_px || pixels.rows != header.height_px)
    throw Error(ErrorCode::kInvalidInput, path.string(), "corrupt: the pixels have another size than the header says",
                kHint);
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

std::uint64_t FolderPixelSource::LoadPeakBytes(const Image& image, bool with_color) const {
  // Result: grey and RGB. Beside it either libjpeg's coefficients of a progressive JPEG (2 bytes a sample, sizes
  // rounded up to blocks), or the file, OpenCV's array and one strip, which may be the whole image (TIFF: as 4 bytes a
  // pixel).
  const auto padded = [](int size) { return static_cast<std::uint64_t>(size) + 31; };
  const std::uint64_t pixels = padded(image.width_px) * padded(image.height_px),
                      sample = image.bits_per_sample > 8 ? 2 : 1;
  const std::uint64_t all = static_cast<std::uint64_t>(image.channels) * sample;
  const std::uint64_t jpeg = image.bits_per_sample > 8 ? 0 : 2 * pixels * all;
  const std::uint64_t other = MaxFileBytes(pixels * all) + pixels * all + pixels * std::max<std::uint64_t>(all, 4);
  return pixels * (sample + (with_color ? 3 : 0)) + std::max(jpeg, other) + kSlackBytes;
}

}  // namespace rilievo::images
