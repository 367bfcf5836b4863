// Masks: which file belongs to which image, and what a mask must be.
#include "stages/images/masks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "stages/images/decode.h"
#include "tests/unit/block/io/scratch_folder.h"

namespace rilievo::images {
namespace {

using testing::HasSubstr;

std::string Encode(const char* extension, const cv::Mat& picture) {
  std::vector<unsigned char> bytes;
  cv::imencode(extension, picture, bytes);
  return {bytes.begin(), bytes.end()};
}

Image Photograph(int width_px, int height_px) {
  Image image;
  image.name = "a.jpg";
  image.width_px = width_px, image.height_px = height_px;
  return image;
}

TEST(MaskFolder, TheNearestNameIsTheMask) {
  const ScratchFolder scratch;
  for (const char* name :
       {"same.jpg", "same.png", "longer.jpg.png", "longer.tif", "other.PNG", "sub/deep.tiff", "two.png", "two.tif"})
    scratch.Write(name, "content is looked at later");
  const MaskFolder masks(scratch.path());
  EXPECT_EQ(masks.size(), 8U);
  EXPECT_EQ(masks.Find("same.jpg"), "same.jpg");
  EXPECT_EQ(masks.Find("longer.jpg"), "longer.jpg.png");
  EXPECT_EQ(masks.Find("other.JPG"), "other.PNG");
  EXPECT_EQ(masks.Find("sub/deep.jpg"), "sub/deep.tiff");
  EXPECT_EQ(masks.Find("deep.jpg"), std::nullopt);
  EXPECT_EQ(masks.Find("sub/same.jpg"), std::nullopt);
  EXPECT_EQ(masks.Find("Other.jpg"), std::nullopt);
  EXPECT_EQ(masks.Find("two.png"), "two.png");
  EXPECT_THAT(ErrorOf([&] { masks.Find("two.jpg"); }),
              testing::AllOf(HasSubstr("two.png"), HasSubstr("two.tif"), HasSubstr("two.jpg")));
  EXPECT_THAT(ErrorOf([&] { MaskFolder(scratch.path() / "none"); }), HasSubstr("no such folder of masks"));
  EXPECT_THAT(ErrorOf([&] { MaskFolder(scratch.path() / "two.png"); }), HasSubstr("no such folder of masks"));
}

TEST(Mask, GreyAndColorGiveABytePerPixel) {
  const ScratchFolder scratch;
  const FolderPixelSource source(scratch.path());
  for (const char* extension : {".png", ".tif"})
    for (const int type : {CV_8UC1, CV_8UC3, CV_8UC4}) {
      cv::Mat picture(20, 30, type, cv::Scalar::all(0));
      picture.colRange(10, 30).setTo(cv::Scalar::all(255));
      const std::string name = std::string("m") + extension;
      scratch.Write(name, Encode(extension, picture));
      const MaskFile mask = InspectMask(scratch.path(), name, Photograph(30, 20));
      EXPECT_EQ(mask.content, HashFile(scratch.path() / name));
      EXPECT_GE(mask.load_peak_bytes, 600U);
      const auto bytes = LoadMask(source, mask, Photograph(30, 20));
      ASSERT_EQ(bytes.size(), 600U);
      for (std::size_t i = 0; i < bytes.size(); ++i) EXPECT_EQ(bytes[i] >= 128, i % 30 >= 10);
    }
}

TEST(Mask, WhatDoesNotFitIsNamed) {
  const ScratchFolder scratch;
  const FolderPixelSource source(scratch.path());
  const std::string png = Encode(".png", cv::Mat(20, 30, CV_8UC1, cv::Scalar(9)));
  scratch.Write("m.png", png);
  EXPECT_THAT(ErrorOf([&] { InspectMask(scratch.path(), "m.png", Photograph(20, 30)); }),
              testing::AllOf(HasSubstr("m.png: is 30 x 20 px"), HasSubstr("a.jpg is 20 x 30 px")));
  scratch.Write("deep.png", Encode(".png", cv::Mat(20, 30, CV_16UC1, cv::Scalar(9))));
  EXPECT_THAT(ErrorOf([&] { InspectMask(scratch.path(), "deep.png", Photograph(30, 20)); }), HasSubstr("16 bits"));
  const MaskFile mask = InspectMask(scratch.path(), "m.png", Photograph(30, 20));
  scratch.Write("m.png", png.substr(0, png.size() - 20));
  EXPECT_THAT(ErrorOf([&] { LoadMask(source, mask, Photograph(30, 20)); }), HasSubstr("mask m.png: truncated"));
  scratch.Write("m.png", Encode(".png", cv::Mat(21, 30, CV_8UC1, cv::Scalar(9))));
  EXPECT_THAT(ErrorOf([&] { LoadMask(source, mask, Photograph(30, 20)); }), HasSubstr("disagree"));
}

}  // namespace
}  // namespace rilievo::images
