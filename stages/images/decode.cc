// Decodes the photographs of a folder to grey (and RGB) pixels.
#include "stages/images/decode.h"

#include "base/error.h"
#include "block/io/image_format.h"
#include "stages/images/jpeg_decoder.h"
#include "stages/images/png_decoder.h"
#include "stages/images/tiff_decoder.h"

namespace rilievo::images {
namespace {

GreyImage Decode(io::ImageFormat format, const std::filesystem::path& path, bool with_color) {
  switch (format) {
    case io::ImageFormat::kJpeg:
      return DecodeJpeg(path, with_color);
    case io::ImageFormat::kPng:
      return DecodePng(path, with_color);
    case io::ImageFormat::kTiff:
      return DecodeTiff(path, with_color);
  }
  return {};
}

}  // namespace

GreyImage FolderPixelSource::Load(const std::string& image_name, bool with_color) const {
  const std::filesystem::path path = folder_ / image_name;
  const io::FormatHeader header = io::ReadFormatHeader(path);
  GreyImage image = Decode(header.format, path, with_color);
  if (image.width_px != header.width_px || image.height_px != header.height_px)
    throw Error(ErrorCode::kInvalidInput, path.string(), "corrupt: the pixels have another size than the header says",
                "copy or export the image again");
  return image;
}

std::uint64_t FolderPixelSource::LoadPeakBytes(const Image& image, bool with_color) const {
  constexpr std::uint64_t kSlackBytes = 1 << 20;
  const auto pixels = static_cast<std::uint64_t>(image.width_px) * static_cast<std::uint64_t>(image.height_px);
  const std::uint64_t sample_bytes = image.bits_per_sample > 8 ? 2 : 1;
  return pixels * (sample_bytes + (with_color ? 3 : 0)) + image.decode_scratch_bytes + kSlackBytes;
}

}  // namespace rilievo::images
