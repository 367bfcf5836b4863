// Image headers: sizes and samples against files written by OpenCV, EXIF against what Exiv2 wrote, and bad files.
#include "block/io/image_header.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <exiv2/exiv2.hpp>
#include <opencv2/imgcodecs.hpp>

#include "tests/unit/block/io/scratch_folder.h"

namespace rilievo::io {
namespace {

using testing::HasSubstr;

std::string Encode(const char* extension, int width, int height, int type) {
  std::vector<unsigned char> bytes;
  cv::imencode(extension, cv::Mat(height, width, type, cv::Scalar::all(100)), bytes);
  return {bytes.begin(), bytes.end()};
}

class ImageHeader : public testing::Test {
 protected:
  Image Read(const std::string& name, const std::string& content) {
    scratch_.Write(name, content);
    return ReadImageHeader(scratch_.path(), name);
  }
  std::string Mistake(const std::string& content) {
    const std::string line = ErrorOf([&] { Read("a b.jpg", content); });
    EXPECT_THAT(line, HasSubstr("a b.jpg: "));
    return line;
  }
  ScratchFolder scratch_;
};

TEST_F(ImageHeader, SizeAndSamples) {
  struct Case {
    const char* extension;
    int type, channels, bits;
  };
  for (const Case& c : {Case{".jpg", CV_8UC3, 3, 8}, Case{".jpg", CV_8UC1, 1, 8}, Case{".png", CV_8UC1, 1, 8},
                        Case{".png", CV_8UC4, 4, 8}, Case{".png", CV_16UC3, 3, 16}, Case{".tif", CV_8UC1, 1, 8},
                        Case{".tif", CV_16UC1, 1, 16}, Case{".tif", CV_16UC3, 3, 16}}) {
    const std::string name = std::string("sub/") + "x" + c.extension, content = Encode(c.extension, 123, 45, c.type);
    const Image image = Read(name, content);
    EXPECT_EQ(image.name, name);
    EXPECT_EQ(image.width_px, 123);
    EXPECT_EQ(image.height_px, 45);
    EXPECT_EQ(image.channels, c.channels) << name;
    EXPECT_EQ(image.bits_per_sample, c.bits) << name;
    EXPECT_EQ(image.exif.orientation, 1);
    EXPECT_EQ(image.content, HashFile(scratch_.path() / name));
  }
}

TEST_F(ImageHeader, ExifOfEveryFormat) {
  for (const char* extension : {".jpg", ".png", ".tif"}) {
    SCOPED_TRACE(extension);
    const auto path = scratch_.Write(std::string("x") + extension, Encode(extension, 120, 80, CV_8UC3));
    {
      const auto file = Exiv2::ImageFactory::open(path.string());
      file->readMetadata();
      Exiv2::ExifData& exif = file->exifData();
      exif["Exif.Image.Orientation"] = std::uint16_t{6};
      exif["Exif.Image.Make"] = "Maker";
      exif["Exif.Image.Model"] = "Model X ";
      exif["Exif.Photo.BodySerialNumber"] = "0815";
      exif["Exif.Photo.LensModel"] = "35mm f/2";
      exif["Exif.Photo.DateTimeOriginal"] = "2024:05:06 07:08:09";
      exif["Exif.Photo.FocalLength"] = Exiv2::Rational(355, 10);
      exif["Exif.Photo.FocalLengthIn35mmFilm"] = std::uint16_t{53};
      exif["Exif.Photo.FocalPlaneXResolution"] = Exiv2::Rational(2540, 1);
      exif["Exif.Photo.FocalPlaneResolutionUnit"] = std::uint16_t{3};  // cm
      exif["Exif.GPSInfo.GPSLatitude"] = "47/1 30/1 36/1";
      exif["Exif.GPSInfo.GPSLatitudeRef"] = "S";
      exif["Exif.GPSInfo.GPSLongitude"] = "8/1 15/1 0/1";
      exif["Exif.GPSInfo.GPSLongitudeRef"] = "W";
      exif["Exif.GPSInfo.GPSAltitude"] = Exiv2::Rational(4005, 10);
      exif["Exif.GPSInfo.GPSAltitudeRef"] = "1";
      file->writeMetadata();
    }
    const Image image = ReadImageHeader(scratch_.path(), path.filename().string());
    EXPECT_EQ(image.width_px, 120);  // the orientation does not swap the sides
    EXPECT_EQ(image.height_px, 80);
    EXPECT_EQ(image.exif.orientation, 6);
    EXPECT_EQ(image.exif.make, "Maker");
    EXPECT_EQ(image.exif.model, "Model X");
    EXPECT_EQ(image.exif.serial, "0815");
    EXPECT_EQ(image.exif.lens, "35mm f/2");
    EXPECT_EQ(image.exif.date_time, "2024:05:06 07:08:09");
    EXPECT_DOUBLE_EQ(image.exif.focal_mm, 35.5);
    EXPECT_DOUBLE_EQ(image.exif.focal_35mm_mm, 53);
    EXPECT_DOUBLE_EQ(image.exif.focal_plane_x_res_per_mm, 254);
    ASSERT_TRUE(image.exif.gnss.has_value());
    EXPECT_NEAR((*image.exif.gnss)[0], -47.51, 1e-9);
    EXPECT_NEAR((*image.exif.gnss)[1], -8.25, 1e-9);
    EXPECT_NEAR((*image.exif.gnss)[2], -400.5, 1e-9);
  }
}

TEST_F(ImageHeader, ExifTextIsUtf8WhateverTheCameraWrote) {
  const auto path = scratch_.Write("x.jpg", Encode(".jpg", 120, 80, CV_8UC3));
  {
    const auto file = Exiv2::ImageFactory::open(path.string());
    file->readMetadata();
    Exiv2::ExifData& exif = file->exifData();
    exif["Exif.Image.Make"] = "Z\xFCrich \x1B[2J\r\n";
    exif["Exif.Image.Model"] = std::string("X\xC3\0junk", 7);
    exif["Exif.Photo.BodySerialNumber"] = "08\n15  ";
    exif["Exif.Photo.LensModel"] = "\xC3\x84";
    exif["Exif.Photo.DateTimeOriginal"] = "\xFF\xFF";
    file->writeMetadata();
  }
  const ExifData exif = ReadImageHeader(scratch_.path(), "x.jpg").exif;
  EXPECT_EQ(exif.make, "Z\xEF\xBF\xBDrich [2J");
  EXPECT_EQ(exif.model, "X\xEF\xBF\xBD");
  EXPECT_EQ(exif.serial, "0815");
  EXPECT_EQ(exif.lens, "\xC3\x84");
  EXPECT_EQ(exif.date_time, "\xEF\xBF\xBD\xEF\xBF\xBD");
}

TEST_F(ImageHeader, DamagedExifLosesOnlyTheExif) {
  std::string jpeg = Encode(".jpg", 120, 80, CV_8UC3);
  jpeg.insert(2, std::string("\xFF\xE1\x00\x14"
                             "Exif\0\0II*\0\xFF\xFF\xFF\xFFgarbag",
                             22));
  testing::internal::CaptureStderr();
  EXPECT_EQ(Read("x.jpg", jpeg).width_px, 120);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST_F(ImageHeader, BadFilesAreNamedWithTheReason) {
  EXPECT_THAT(Mistake(""), HasSubstr("empty file (0 bytes)"));
  EXPECT_THAT(Mistake("this is a text"), HasSubstr("is no JPEG, PNG or TIFF"));
  EXPECT_THAT(Mistake("\xFF"), HasSubstr("is no JPEG, PNG or TIFF"));
  EXPECT_THAT(ErrorOf([&] { ReadImageHeader(scratch_.path(), "none.jpg"); }), HasSubstr("cannot be opened"));
  for (const char* extension : {".jpg", ".png", ".tif"}) {
    const std::string content = Encode(extension, 120, 80, CV_8UC3);
    EXPECT_THAT(Mistake(content.substr(0, 20)), HasSubstr("truncated"));
  }
  const std::string tiff = Encode(".tif", 120, 80, CV_32FC1);
  EXPECT_THAT(Mistake(tiff), testing::AnyOf(HasSubstr("floating point"), HasSubstr("32 bits a sample")));

  std::string huge = Encode(".png", 120, 80, CV_8UC1);
  huge[16] = huge[20] = '\x40';
  EXPECT_THAT(Mistake(huge), HasSubstr("implausible image size"));
  std::string empty = Encode(".png", 120, 80, CV_8UC1);
  empty[19] = '\0';
  EXPECT_THAT(Mistake(empty), HasSubstr("implausible image size 0 x 80"));
  std::string jpeg = Encode(".jpg", 120, 80, CV_8UC3);
  const auto frame = jpeg.find("\xFF\xC0");
  jpeg[frame + 4] = 12;
  EXPECT_THAT(Mistake(jpeg), HasSubstr("12-bit JPEG"));
  jpeg[frame + 4] = 8;
  jpeg[frame + 9] = 4;
  EXPECT_THAT(Mistake(jpeg), HasSubstr("CMYK JPEG"));
}

void PutBigEndian(std::string& content, std::size_t at, unsigned value, int bytes) {
  for (int i = 0; i < bytes; ++i)
    content[at + static_cast<std::size_t>(i)] = static_cast<char>(value >> 8 * (bytes - 1 - i));
}

/// `content` as if its header said `width` x `height`.
std::string Resized(std::string content, const std::string& extension, unsigned width, unsigned height) {
  if (extension == ".png") {
    PutBigEndian(content, 16, width, 4);
    PutBigEndian(content, 20, height, 4);
  } else if (extension == ".jpg") {
    const auto frame = std::min(content.find("\xFF\xC0"), content.find("\xFF\xC2"));
    PutBigEndian(content, frame + 5, height, 2);
    PutBigEndian(content, frame + 7, width, 2);
  } else {
    for (const auto& [tag, value] : {std::pair{'\0', width}, std::pair{'\1', height}}) {
      const auto entry =
          content.find(std::string{tag, '\1', '\3', '\0', '\1', '\0', '\0', '\0'});  // little endian SHORT
      content[entry + 8] = static_cast<char>(value);
      content[entry + 9] = static_cast<char>(value >> 8);
    }
  }
  return content;
}

std::string EncodeFlat(const std::string& extension, int side, int type, const std::vector<int>& options) {
  std::vector<unsigned char> bytes;
  cv::imencode(extension, cv::Mat(side, side, type, cv::Scalar::all(128)), bytes, options);
  return {bytes.begin(), bytes.end()};
}

// A flat picture is what its format compresses best: it is taken, and refused as soon as its header lies.
TEST_F(ImageHeader, FilesTooShortForTheirSizeAreRefused) {
  struct Case {
    std::string extension;
    std::vector<int> options;
  };
  const std::vector<Case> cases{
      {".png", {cv::IMWRITE_PNG_COMPRESSION, 9}},
      {".png", {cv::IMWRITE_PNG_BILEVEL, 1}},
      {".jpg", {cv::IMWRITE_JPEG_QUALITY, 1, cv::IMWRITE_JPEG_OPTIMIZE, 1}},
      {".jpg", {cv::IMWRITE_JPEG_QUALITY, 1, cv::IMWRITE_JPEG_PROGRESSIVE, 1, cv::IMWRITE_JPEG_OPTIMIZE, 1}},
      {".tif", {cv::IMWRITE_TIFF_COMPRESSION, 1}},
      {".tif", {cv::IMWRITE_TIFF_COMPRESSION, 5}},
      {".tif", {cv::IMWRITE_TIFF_COMPRESSION, 8}},
      {".tif", {cv::IMWRITE_TIFF_COMPRESSION, 32773}},
      {".tif", {cv::IMWRITE_TIFF_COMPRESSION, 50000}}};
  for (std::size_t i = 0; i < cases.size(); ++i)
    for (const int type : {CV_8UC1, CV_8UC3, CV_16UC3}) {
      const auto& [extension, options] = cases[i];
      SCOPED_TRACE(extension + " " + std::to_string(i) + " of type " + std::to_string(type));
      if (type != CV_8UC1 && i == 1) continue;  // bilevel
      const std::string name = "a" + extension, large = EncodeFlat(extension, 1500, type, options);
      ASSERT_FALSE(large.empty());
      EXPECT_EQ(Read(name, large).width_px, 1500);
      if (i == 8) continue;  // the bound of Zstandard is beyond a file's fixed parts here
      const std::string lie = Resized(EncodeFlat(extension, 8, type, options), extension, 20000, 20000);
      EXPECT_THAT(ErrorOf([&] { Read(name, lie); }),
                  testing::AllOf(HasSubstr("its header says 20000 x 20000 px"), HasSubstr("cannot be enough")));
    }
}

// libjpeg keeps the coefficients of a progressive file: 2 bytes a sample, of which 4:2:0 has one and a half a pixel.
TEST_F(ImageHeader, ScratchOfDecodingFollowsTheKindOfFile) {
  const double pixels = 2000.0 * 1500;
  const auto scratch = [&](const char* extension, int type, const std::vector<int>& options = {}) {
    std::vector<unsigned char> bytes;
    cv::imencode(extension, cv::Mat(1500, 2000, type, cv::Scalar::all(90)), bytes, options);
    return static_cast<double>(Read(std::string("s") + extension, {bytes.begin(), bytes.end()}).decode_scratch_bytes);
  };
  EXPECT_LT(scratch(".jpg", CV_8UC3), 2e6);
  EXPECT_NEAR(scratch(".jpg", CV_8UC3, {cv::IMWRITE_JPEG_PROGRESSIVE, 1}), 3 * pixels, 2e6);
  EXPECT_NEAR(scratch(".jpg", CV_8UC1, {cv::IMWRITE_JPEG_PROGRESSIVE, 1}), 2 * pixels, 2e6);
  EXPECT_LT(scratch(".png", CV_8UC3), 2e6);
  EXPECT_LT(scratch(".png", CV_16UC4), 2e6);
  EXPECT_LT(scratch(".tif", CV_8UC3), 3e6);
}

TEST(ImageHeaderOfRealData, ExifOfACamera) {
  if (DataFolder().empty()) GTEST_SKIP() << "RILIEVO_DATA is not set";
  const Image image = ReadImageHeader(DataFolder() / "cyprus10/images", "DSC_6466.JPG");
  EXPECT_EQ(image.width_px, 1500);
  EXPECT_EQ(image.exif.model, "NIKON D3X");
  EXPECT_EQ(image.exif.focal_mm, 28);
}

}  // namespace
}  // namespace rilievo::io
