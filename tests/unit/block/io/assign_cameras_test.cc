// Which camera an image gets, and the calibrations that do not fit.
#include "block/io/assign_cameras.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/block/io/scratch_folder.h"

namespace rilievo::io {
namespace {

using testing::HasSubstr;

Image MakeImage(const std::string& name, int width, int height) {
  Image image;
  image.name = name;
  image.width_px = width;
  image.height_px = height;
  return image;
}

CalibrationEntry Entry(int width, int height, double focal, const std::string& folder = "",
                       const std::string& label = "cal") {
  return {CameraModel{CameraModelKind::kPinhole, focal, focal, 0.5 * width + 5, 0.5 * height - 5}, width, height,
          folder, label};
}

CalibrationEntry AnySize(CalibrationEntry entry) {
  entry.width_px = entry.height_px = 0;
  return entry;
}

double FocalOf(const BlockWithWarnings& made, std::uint32_t image) {
  return made.block.camera_of(ImageId(image)).model.fx;
}

TEST(MakeBlock, IdsAndOrderAndQuarantine) {
  const auto made = MakeBlock({MakeImage("b", 60, 40), MakeImage("a", 60, 40)}, {{"c", "bad"}}, {Entry(60, 40, 50)});
  EXPECT_EQ(made.block.images[1].id, ImageId(1));
  EXPECT_EQ(made.block.images[1].name, "a");
  EXPECT_EQ(made.block.quarantined.at(0).name, "c");
  ASSERT_EQ(made.block.cameras.size(), 1U);
  EXPECT_EQ(made.block.cameras[0].id, CameraId(0));
  EXPECT_EQ(made.block.cameras[0].source, CalibrationSource::kGiven);
  EXPECT_TRUE(made.warnings.empty());
}

TEST(MakeBlock, BySizeByFolderAndAnySize) {
  const auto made = MakeBlock(
      {MakeImage("a", 60, 40), MakeImage("b", 40, 60), MakeImage("left/c", 60, 40), MakeImage("left/in/d", 60, 40),
       MakeImage("left2/e", 60, 40)},
      {}, {Entry(60, 40, 50), Entry(40, 60, 51), AnySize(Entry(60, 40, 52, "left")), Entry(60, 40, 53, "left/in")});
  EXPECT_EQ(FocalOf(made, 0), 50);
  EXPECT_EQ(FocalOf(made, 1), 51);
  EXPECT_EQ(FocalOf(made, 2), 52);
  EXPECT_EQ(FocalOf(made, 3), 53);
  EXPECT_EQ(FocalOf(made, 4), 50);
  const auto any = MakeBlock({MakeImage("a", 60, 40)}, {}, {AnySize(Entry(60, 40, 50))});
  EXPECT_EQ(any.block.cameras.at(0).width_px, 60);
}

std::string Mistake(std::vector<Image> images, std::vector<CalibrationEntry> entries) {
  return ErrorOf([&] { MakeBlock(images, {}, entries); });
}

TEST(MakeBlock, CalibrationsThatDoNotFit) {
  EXPECT_THAT(Mistake({MakeImage("first.jpg", 640, 480), MakeImage("b", 640, 480)}, {Entry(3072, 2048, 2759)}),
              testing::AllOf(HasSubstr("first.jpg: "), HasSubstr("640 x 480"), HasSubstr("3072 x 2048")));
  EXPECT_THAT(Mistake({MakeImage("a", 2048, 3072)}, {Entry(3072, 2048, 2759)}), HasSubstr("the image is turned"));
  EXPECT_THAT(Mistake({MakeImage("a", 640, 480)}, {AnySize(Entry(3072, 2048, 2759))}),
              HasSubstr("does not fit image size"));
  EXPECT_THAT(Mistake({MakeImage("a", 2048, 3072)}, {AnySize(Entry(3072, 2048, 2759))}),
              HasSubstr("does not fit image size"));
  EXPECT_THAT(
      Mistake({MakeImage("a", 3072, 2048), MakeImage("b", 3000, 2000)}, {AnySize(Entry(3072, 2048, 2759))}),
      testing::AllOf(HasSubstr("b: one calibration"), HasSubstr("3072 x 2048 px (a)"), HasSubstr("3000 x 2000")));
  EXPECT_THAT(Mistake({MakeImage("a", 60, 40)}, {Entry(60, 40, 50, "", "one"), Entry(60, 40, 51, "", "two")}),
              testing::AllOf(HasSubstr("2 calibrations fit this image equally: one; two"),
                             HasSubstr("TOML with a [[camera]] and its folder =")));
  EXPECT_THAT(Mistake({MakeImage("right/a", 60, 40), MakeImage("b", 60, 40)}, {Entry(60, 40, 50, "left")}),
              HasSubstr("right/a: no calibration is for the folder of this image and 1 more"));
}

ExifData Exif(double focal_mm, double focal_35mm, double resolution, const std::string& model) {
  ExifData exif;
  exif.focal_mm = focal_mm;
  exif.focal_35mm_mm = focal_35mm;
  exif.focal_plane_x_res_per_mm = resolution;
  exif.model = model;
  return exif;
}

BlockWithWarnings FromExif(const ExifData& exif, int width = 6000, int height = 4000) {
  Image image = MakeImage("a", width, height);
  image.exif = exif;
  return MakeBlock({image}, {}, {});
}

TEST(MakeBlock, FocalLengthFromExif) {
  // A full-frame sensor 36 mm wide, 6000 px: 24 mm are 4000 px by every way that EXIF tells it.
  EXPECT_NEAR(FocalOf(FromExif(Exif(24, 0, 6000 / 36.0, "")), 0), 4000, 1e-6);
  EXPECT_NEAR(FocalOf(FromExif(Exif(0, 24, 0, "")), 0), 4000, 0.1);
  EXPECT_NEAR(FocalOf(FromExif(Exif(24, 0, 0, "NIKON D3")), 0), 4000, 1e-6);
  EXPECT_NEAR(FocalOf(FromExif(Exif(24, 0, 0, "NIKON D3"), 4000, 6000), 0), 4000, 1e-6);  // portrait
  // Resized to a quarter: the focal plane resolution still speaks of the large image, the 35 mm equivalent does not.
  EXPECT_NEAR(FocalOf(FromExif(Exif(24, 24, 6000 / 36.0, ""), 1500, 1000), 0), 1000, 0.1);
  const auto made = FromExif(Exif(24, 24, 0, ""));
  EXPECT_EQ(made.block.cameras[0].source, CalibrationSource::kExif);
  EXPECT_EQ(made.block.cameras[0].model.cx, 3000);
  EXPECT_EQ(made.block.cameras[0].model.cy, 2000);
  EXPECT_THAT(made.warnings.at(0),
              testing::AllOf(HasSubstr("NO CALIBRATION"), HasSubstr("from EXIF"), HasSubstr("--calibration")));
}

TEST(MakeBlock, FocalLengthGuessedIsLouder) {
  for (const ExifData& exif : {ExifData{}, Exif(24, 0, 0, "unheard of"), Exif(24, 100000, 1e9, "")}) {
    const auto made = FromExif(exif);
    EXPECT_EQ(FocalOf(made, 0), 7200);
    EXPECT_EQ(made.block.cameras[0].source, CalibrationSource::kGuessed);
    EXPECT_THAT(made.warnings.at(0), HasSubstr("NO FOCAL LENGTH IN EXIF"));
  }
}

TEST(MakeBlock, ImagesOfOneCameraShareIt) {
  std::vector<Image> images(4, MakeImage("a", 6000, 4000));
  for (auto& image : images) image.exif = Exif(24, 24, 0, "X");
  images[2].exif.focal_mm = images[2].exif.focal_35mm_mm = 35;  // zoomed
  images[3].exif.serial = "other body";
  const auto made = MakeBlock(images, {}, {});
  EXPECT_EQ(made.block.cameras.size(), 3U);
  EXPECT_EQ(made.block.images[0].camera_id, made.block.images[1].camera_id);
  ASSERT_EQ(made.warnings.size(), 3U);
  EXPECT_THAT(made.warnings[0], HasSubstr("(2 images of 6000 x 4000 px"));
  EXPECT_THAT(made.warnings[1], HasSubstr("(1 image of 6000 x 4000 px"));
}

}  // namespace
}  // namespace rilievo::io
