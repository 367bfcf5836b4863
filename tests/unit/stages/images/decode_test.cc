// Decoding: pixels against what was written, equal grey with and without colour, and every kind of damage.
#include "stages/images/decode.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <exiv2/exiv2.hpp>
#include <opencv2/imgcodecs.hpp>

#include "base/rng.h"
#include "block/io/image_header.h"
#include "tests/unit/block/io/scratch_folder.h"

namespace rilievo::images {
namespace {

using testing::HasSubstr;

/// Smooth structure and a little noise: a truncated or damaged part is visible, compression keeps the rest.
cv::Mat Picture(int width, int height, int type) {
  cv::Mat picture(height, width, type);
  Rng rng(11);
  const int channels = picture.channels();
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width * channels; ++x) {
      const double value =
          0.5 + 0.2 * std::sin(0.05 * x / channels + x % channels) + 0.2 * std::cos(0.07 * y) + 0.02 * rng.Normal();
      if (picture.depth() == CV_8U)
        picture.ptr<std::uint8_t>(y)[x] = cv::saturate_cast<std::uint8_t>(255 * value);
      else
        picture.ptr<std::uint16_t>(y)[x] = cv::saturate_cast<std::uint16_t>(65535 * value);
    }
  return picture;
}

std::string Encode(const char* extension, const cv::Mat& picture, const std::vector<int>& options = {}) {
  std::vector<unsigned char> bytes;
  cv::imencode(extension, picture, bytes, options);
  return {bytes.begin(), bytes.end()};
}

class Decode : public testing::Test {
 protected:
  GreyImage Load(const std::string& name, const std::string& content, bool with_color = false) {
    scratch_.Write(name, content);
    return source_.Load(name, with_color);
  }
  std::string Mistake(const std::string& name, const std::string& content) {
    testing::internal::CaptureStderr();
    const std::string line = ErrorOf([&] { Load(name, content); });
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << "a library talks";
    EXPECT_THAT(line, HasSubstr(name));
    return line;
  }
  ScratchFolder scratch_;
  FolderPixelSource source_{scratch_.path()};
};

template <class T>
double LargestGreyError(const cv::Mat& picture, const std::vector<T>& grey) {
  double largest = 0;
  for (int y = 0; y < picture.rows; ++y)
    for (int x = 0; x < picture.cols; ++x) {
      const T* p = picture.ptr<T>(y) + x * picture.channels();
      const double luma = picture.channels() == 1 ? p[0] : 0.299 * p[2] + 0.587 * p[1] + 0.114 * p[0];
      largest = std::max(largest, std::abs(luma - grey[static_cast<std::size_t>(y * picture.cols + x)]));
    }
  return largest;
}

TEST_F(Decode, LosslessFormatsGiveTheirPixels) {
  for (const char* extension : {".png", ".tif"})
    for (const int type : {CV_8UC1, CV_8UC3, CV_8UC4, CV_16UC1, CV_16UC3, CV_16UC4}) {
      SCOPED_TRACE(std::string(extension) + " " + std::to_string(type));
      const cv::Mat picture = Picture(67, 45, type);
      const std::string name = std::string("\xC3\xBC a") + extension;
      const GreyImage grey = Load(name, Encode(extension, picture)),
                      both = Load(name, Encode(extension, picture), true);
      EXPECT_EQ(grey.width_px, 67);
      EXPECT_EQ(grey.height_px, 45);
      ASSERT_EQ(grey.Is16Bit(), picture.depth() == CV_16U);
      EXPECT_LE(grey.Is16Bit() ? LargestGreyError(picture, grey.u16) : LargestGreyError(picture, grey.u8),
                grey.Is16Bit() ? 3.0 : 0.6);
      EXPECT_EQ(grey.u8, both.u8);
      EXPECT_EQ(grey.u16, both.u16);
      EXPECT_TRUE(grey.rgb.empty());
      ASSERT_EQ(both.rgb.size(), 3U * 67 * 45);
      const int scale = grey.Is16Bit() ? 257 : 1, c = picture.channels();
      const auto value = [&](int k) {
        return grey.Is16Bit() ? picture.ptr<std::uint16_t>(7)[9 * c + k] : picture.ptr<std::uint8_t>(7)[9 * c + k];
      };
      for (int k = 0; k < 3; ++k)
        EXPECT_NEAR(both.rgb[static_cast<std::size_t>(3 * (7 * 67 + 9) + k)], value(c == 1 ? 0 : 2 - k) / scale, 1);
    }
}

// Third witness: OpenCV's own decoding of the same JPEG, colour and grey.
TEST_F(Decode, JpegAgreesWithAnotherDecoder) {
  for (const bool progressive : {false, true})
    for (const int type : {CV_8UC1, CV_8UC3}) {
      const std::string jpeg = Encode(".jpg", Picture(133, 77, type),
                                      {cv::IMWRITE_JPEG_QUALITY, 92, cv::IMWRITE_JPEG_PROGRESSIVE, progressive});
      const GreyImage grey = Load("a.jpg", jpeg), both = Load("a.jpg", jpeg, true);
      const cv::Mat bytes(1, static_cast<int>(jpeg.size()), CV_8U, const_cast<char*>(jpeg.data()));
      EXPECT_EQ(LargestGreyError(cv::imdecode(bytes, cv::IMREAD_GRAYSCALE), grey.u8), 0);
      EXPECT_EQ(grey.u8, both.u8);
      const cv::Mat color = cv::imdecode(bytes, cv::IMREAD_COLOR);
      int largest = 0;
      for (std::size_t i = 0; i < both.rgb.size(); ++i)
        largest = std::max(largest, std::abs(both.rgb[i] - color.data[i / 3 * 3 + 2 - i % 3]));
      EXPECT_LE(largest, 1);
    }
}

TEST_F(Decode, PixelsAreAsStoredWhateverTheOrientationTag) {
  for (const char* extension : {".jpg", ".tif"}) {
    const cv::Mat picture = Picture(40, 24, CV_8UC3);
    const std::string name = std::string("a") + extension;
    const GreyImage plain = Load(name, Encode(extension, picture));
    {
      const auto image = Exiv2::ImageFactory::open((scratch_.path() / name).string());
      image->readMetadata();
      image->exifData()["Exif.Image.Orientation"] = std::uint16_t{8};
      image->writeMetadata();
    }
    EXPECT_EQ(io::ReadImageHeader(scratch_.path(), name).exif.orientation, 8);
    const GreyImage turned = source_.Load(name, false);
    EXPECT_EQ(turned.width_px, 40);
    EXPECT_EQ(turned.u8, plain.u8);
  }
}

TEST_F(Decode, TruncationIsSeenAtAnyPlace) {
  const cv::Mat picture = Picture(200, 150, CV_8UC3);
  const std::vector<std::pair<std::string, std::string>> files{
      {"baseline.jpg", Encode(".jpg", picture)},
      {"progressive.jpg", Encode(".jpg", picture, {cv::IMWRITE_JPEG_PROGRESSIVE, 1})},
      {"restart.jpg", Encode(".jpg", picture, {cv::IMWRITE_JPEG_RST_INTERVAL, 4})},
      {"a.png", Encode(".png", picture)},
      {"a.tif", Encode(".tif", picture)}};
  for (const auto& [name, content] : files) {
    EXPECT_EQ(Load(name, content).u8.size(), 200U * 150);
    EXPECT_THAT(Mistake(name, content.substr(0, content.size() / 2)), HasSubstr("truncated"));
    for (std::size_t keep = 1; keep < content.size() - 10; keep += content.size() / 13) {
      SCOPED_TRACE(keep);
      Mistake(name, content.substr(0, keep));
    }
  }
}

TEST_F(Decode, DamageInsideIsSeen) {
  const cv::Mat picture = Picture(200, 150, CV_8UC3);
  std::string jpeg = Encode(".jpg", picture), png = Encode(".png", picture);
  Rng rng(2);
  for (std::size_t i = jpeg.size() / 2; i < jpeg.size() / 2 + 400; ++i) jpeg[i] = static_cast<char>(rng.Below(256));
  EXPECT_THAT(Mistake("a.jpg", jpeg), HasSubstr("corrupt JPEG"));
  png[png.size() / 2] = static_cast<char>(png[png.size() / 2] ^ 1);
  EXPECT_THAT(Mistake("a.png", png), HasSubstr("wrong checksum"));
  EXPECT_THAT(Mistake("a.jpg", "no image at all"), HasSubstr("is no JPEG, PNG or TIFF"));
  EXPECT_THAT(Mistake("a.jpg", ""), HasSubstr("empty file"));
  EXPECT_THAT(ErrorOf([&] { source_.Load("none.jpg", false); }), HasSubstr("cannot be opened"));
}

TEST_F(Decode, BytesAfterTheEndDoNotHarm) {
  const std::string jpeg = Encode(".jpg", Picture(64, 48, CV_8UC3));
  EXPECT_EQ(Load("a.jpg", jpeg + std::string(5000, 'x')).u8, Load("b.jpg", jpeg).u8);
}

TEST_F(Decode, PeakIsAtLeastTheResult) {
  Image image;
  image.width_px = 4000, image.height_px = 3000, image.channels = 3;
  EXPECT_GT(source_.LoadPeakBytes(image, true), 4000ULL * 3000 * 4);
  EXPECT_GT(source_.LoadPeakBytes(image, false), 4000ULL * 3000);
}

}  // namespace
}  // namespace rilievo::images
