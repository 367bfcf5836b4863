// Every calibration format, its conversions, and the mistakes people make.
#include "block/io/calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "block/io/camera_params.h"
#include "tests/unit/block/io/scratch_folder.h"
#include "tests/unit/block/io/small_block.h"

namespace rilievo::io {
namespace {

using testing::HasSubstr;

class Calibration : public testing::Test {
 protected:
  std::vector<CalibrationEntry> Read(const std::string& content, PixelOrigin origin = PixelOrigin::kCorner) {
    return ReadCalibration(scratch_.Write("my calibration.dat", content), origin);
  }
  std::string Mistake(const std::string& content) {
    const std::string line = ErrorOf([&] { Read(content); });
    EXPECT_THAT(line, HasSubstr("my calibration.dat: "));
    return line;
  }
  ScratchFolder scratch_;
};

void ExpectK(const CameraModel& model, double fx, double fy, double cx, double cy) {
  EXPECT_EQ(model.fx, fx);
  EXPECT_EQ(model.fy, fy);
  EXPECT_EQ(model.cx, cx);
  EXPECT_EQ(model.cy, cy);
}

TEST_F(Calibration, MatrixTextInTheFormsPeopleWriteIt) {
  for (const char* content : {"2759.48 0 1520.69 \r\n0 2764.16 1006.81 \r\n0 0 1",
                              "# my K\n2759.48, 0, 1520.69,\n\n0, 2764.16, 1006.81 # second row\n0 0 1\n",
                              "[[2759.48, 0.0, 1520.69],\n [0.0, 2764.16, 1006.81],\n [0.0, 0.0, 1.0]]\n",
                              "[2759.48, 0, 1520.69; 0, 2764.16, 1006.81; 0, 0, 1]",
                              "% K\n2.75948e3\t0\t+1520.69\n0\t2764.16\t1006.81\n0\t0\t1e0"}) {
    SCOPED_TRACE(content);
    const auto entries = Read(content);
    ASSERT_EQ(entries.size(), 1U);
    ExpectK(entries[0].model, 2759.48, 2764.16, 1520.69, 1006.81);
    EXPECT_EQ(entries[0].model.kind, CameraModelKind::kPinhole);
    EXPECT_EQ(entries[0].width_px, 0);
    EXPECT_EQ(entries[0].label, "my calibration.dat");
  }
}

TEST_F(Calibration, CentreOriginMovesThePrincipalPointByHalfAPixel) {
  ExpectK(Read("100 0 50 0 100 40 0 0 1", PixelOrigin::kCenter)[0].model, 100, 100, 50.5, 40.5);
  ExpectK(Read("1 PINHOLE 100 80 90 91 50 40", PixelOrigin::kCenter)[0].model, 90, 91, 50.5, 40.5);
}

TEST_F(Calibration, MatrixTextMistakes) {
  EXPECT_THAT(Mistake("100 0 50 0 100 40 0 0"), HasSubstr("has 8 of the 9 numbers"));
  EXPECT_THAT(Mistake("100 0 50\n0 100 40\n0 0 1\n0.1 0.2"), HasSubstr("line 4: more than the 9 numbers"));
  EXPECT_THAT(Mistake("100 0 50\n0 1OO 40\n0 0 1"), HasSubstr("line 2: '1OO' is not a number"));
  EXPECT_THAT(Mistake("nan 0 50 0 100 40 0 0 1"), HasSubstr("'nan' is not a number"));
  EXPECT_THAT(Mistake("-100 0 50 0 100 40 0 0 1"), HasSubstr("focal length is not positive"));
  EXPECT_THAT(Mistake("100 0 50 0 0 40 0 0 1"), HasSubstr("focal length is not positive"));
  EXPECT_THAT(Mistake("100 0 0 0 100 0 50 40 1"), HasSubstr("is no K matrix"));  // transposed
  EXPECT_THAT(Mistake("100 3 50 0 100 40 0 0 1"), HasSubstr("skew 3 is not supported"));
}

TEST_F(Calibration, OtherFilesAreNamedAsSuch) {
  EXPECT_THAT(Mistake(""), HasSubstr("is empty"));
  EXPECT_THAT(Mistake("# only\n"), HasSubstr("comments only"));
  EXPECT_THAT(Mistake(std::string("\xFF\xD8\xFF\xE0\0\x10JFIF", 10)), HasSubstr("binary file"));
  EXPECT_THAT(Mistake("<?xml version=\"1.0\"?>\n<document version=\"1.5.0\"><chunk/></document>"),
              HasSubstr("XML file of another program"));
  EXPECT_THAT(Mistake("{\"a\": 1}"), HasSubstr("a calibration is a 3x3 K matrix as text"));
  EXPECT_THAT(ErrorOf([&] { ReadCalibration(scratch_.path() / "none.txt", PixelOrigin::kCorner); }),
              HasSubstr("cannot be opened"));
  EXPECT_THAT(ErrorOf([&] { ReadCalibration(scratch_.path(), PixelOrigin::kCorner); }), HasSubstr("is a folder"));
}

TEST_F(Calibration, ColmapCamerasOfEverySupportedModel) {
  std::string content = "# Camera list\n";
  std::vector<CameraModel> truth;
  for (const auto kind : {CameraModelKind::kSimplePinhole, CameraModelKind::kPinhole, CameraModelKind::kSimpleRadial,
                          CameraModelKind::kRadial, CameraModelKind::kOpenCv, CameraModelKind::kFullOpenCv}) {
    truth.push_back(TestCamera(kind));
    content += std::to_string(truth.size()) + " " + std::string(CameraModelName(kind)) + " 4000 3000";
    char number[40];
    for (const double value : CameraParams(truth.back()))
      content += (std::snprintf(number, sizeof number, " %.17g", value), number);
    content += "\n";
  }
  const auto entries = Read(content);
  ASSERT_EQ(entries.size(), truth.size());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    EXPECT_EQ(entries[i].model.kind, truth[i].kind);
    EXPECT_EQ(entries[i].width_px, 4000);
    EXPECT_EQ(entries[i].height_px, 3000);
    EXPECT_EQ(CameraParams(entries[i].model), CameraParams(truth[i]));
    EXPECT_EQ(*entries[i].model.Project({0.1, 0.2, 1}), *truth[i].Project({0.1, 0.2, 1}));
  }
}

TEST_F(Calibration, ColmapMistakes) {
  EXPECT_THAT(Mistake("# c\n1 OPENCV_FISHEYE 10 10 5 5 5 5 0 0 0 0"),
              HasSubstr("line 2: camera model OPENCV_FISHEYE is not supported"));
  EXPECT_THAT(Mistake("1 FOV 10 10 5 5 5 5 0.1"), HasSubstr("camera model FOV is not supported"));
  EXPECT_THAT(Mistake("1 PINHOLE 10 10 5 5 5"), HasSubstr("PINHOLE has 4 parameters, 3 are given"));
  EXPECT_THAT(Mistake("1 PINHOLE 10 10 5 5 5 inf"), HasSubstr("line 1: 'inf' is not a number"));
  EXPECT_THAT(Mistake("1 PINHOLE 0 10 5 5 5 5"), HasSubstr("positive whole numbers"));
  EXPECT_THAT(Mistake("1 PINHOLE 10 10 5 -5 5 5"), HasSubstr("focal length is not positive"));
}

TEST_F(Calibration, TomlGivesNumbersAndTextsExactly) {
  const auto entries = Read(R"(format = "rilievo-calibration"
version = 1

[[camera]]
label = "simulated \"A\\B\" \u00e4\n"
width_px = 4000
height_px = 3000
model = "FULL_OPENCV"
fx_px = 4400.25
fy_px = 3.3333333333333331e20
cx_px = 2000
cy_px = 1500.1
k1 = 1e-300
k2 = -0.2
k3 = 0.3
k4 = 0.4
k5 = 0.5
k6 = 0.6
p1 = 0.7
p2 = 0.8
[[camera]]
folder = "left side/a"
fx_px = 1.0
fy_px = 2.0
cx_px = 3.0
cy_px = 4.0
)");
  ASSERT_EQ(entries.size(), 2U);
  EXPECT_EQ(entries[0].label, "simulated \"A\\B\" \xC3\xA4\n");
  EXPECT_EQ(entries[0].width_px, 4000);
  EXPECT_EQ(entries[0].height_px, 3000);
  EXPECT_EQ(entries[0].model.kind, CameraModelKind::kFullOpenCv);
  EXPECT_THAT(CameraParams(entries[0].model),
              testing::ElementsAre(4400.25, 1e21 / 3, 2000, 1500.1, 1e-300, -0.2, 0.7, 0.8, 0.3, 0.4, 0.5, 0.6));
  EXPECT_EQ(entries[1].folder, "left side/a");
  EXPECT_EQ(entries[1].width_px, 0);
  EXPECT_EQ(entries[1].model.kind, CameraModelKind::kPinhole);
  EXPECT_THAT(CameraParams(entries[1].model), testing::ElementsAre(1, 2, 3, 4));
}

TEST_F(Calibration, TomlAsDocumented) {
  const std::string head = "format = \"rilievo-calibration\"\nversion = 1\n";
  const std::string camera =
      "[[camera]]\nwidth_px = 4000\nheight_px = 3000\nfx_px = 4400\nfy_px = 4400.5\ncx_px = 2000.0\ncy_px = 1500.0\n";
  const auto entries = Read(head + camera + "k1 = -0.1\nfolder = \"left/\"\n", PixelOrigin::kCenter);
  ExpectK(entries.at(0).model, 4400, 4400.5, 2000, 1500);  // TOML has one origin, whatever the option for text says
  EXPECT_EQ(entries[0].model.kind, CameraModelKind::kOpenCv);
  EXPECT_EQ(entries[0].folder, "left");

  EXPECT_THAT(Mistake(head + camera + "k7 = 1.0\n"), HasSubstr("line 10: unknown key 'k7'"));
  EXPECT_THAT(Mistake(head + camera + "model = \"PINHOLE\"\nk1 = 0.1\n"), HasSubstr("PINHOLE does not have all"));
  EXPECT_THAT(Mistake(head + camera + "model = \"SIMPLE_RADIAL\"\n"),
              HasSubstr("SIMPLE_RADIAL does not have all"));  // fx != fy
  EXPECT_THAT(Mistake(head + camera + "model = \"FISHEYE\"\n"), HasSubstr("'FISHEYE' is not supported"));
  EXPECT_THAT(Mistake(head + camera + "k1 = nan\n"), HasSubstr("not finite"));
  EXPECT_THAT(Mistake(head + camera + "k1 = \"0.1\"\n"), HasSubstr("line 10: 'k1' must be a number"));
  EXPECT_THAT(Mistake(head + "[[camera]]\nfx_px = 1.0\nfy_px = 1.0\ncx_px = 1.0\n"), HasSubstr("lacks 'cy_px'"));
  EXPECT_THAT(Mistake(head + "[[camera]]\nfx_px = 1.0\nfy_px = 1.0\ncx_px = 1.0\ncy_px = 1.0\nwidth_px = 7\n"),
              HasSubstr("go together"));
  EXPECT_THAT(Mistake(head + "[[camera]]\nfx_px = 1.0\nfy_px = 0.0\ncx_px = 1.0\ncy_px = 1.0\n"),
              HasSubstr("not positive"));
  EXPECT_THAT(Mistake(head), HasSubstr("has no [[camera]]"));
  EXPECT_THAT(Mistake("version = 1\n" + camera), HasSubstr("lacks format"));
  EXPECT_THAT(Mistake("format = \"rilievo-calibration\"\nversion = 2\n" + camera), HasSubstr("version 2 is not known"));
  EXPECT_THAT(Mistake(head + "[[camera]\nfx_px = 1.0\n"), HasSubstr("is not valid TOML"));
  EXPECT_THAT(Mistake(head + camera + "k1 = 0.1.2\n"), HasSubstr("is not valid TOML"));
}

/// OpenCV writes the file itself, so that the test does not share our idea of it.
std::string OpenCvFile(const std::string& extension, const cv::Mat& k, const cv::Mat& d, bool with_size) {
  cv::FileStorage file("x" + extension, cv::FileStorage::WRITE | cv::FileStorage::MEMORY);
  if (with_size) file << "image_width" << 640 << "image_height" << 480;
  file << "camera_matrix" << k << "distortion_coefficients" << d;
  return file.releaseAndGetString();
}

TEST_F(Calibration, OpenCvYamlAndXml) {
  const cv::Mat k = (cv::Mat_<double>(3, 3) << 535.9, 0, 342.3, 0, 536.1, 235.6, 0, 0, 1);
  const std::vector<double> all{-0.27, -0.04, 0.0018, -0.0003, 0.24, 0.01, 0.02, 0.03};
  for (const char* extension : {".yml", ".xml"})
    for (const int count : {4, 5, 8}) {
      const cv::Mat d(1, count, CV_64F, const_cast<double*>(all.data()));
      const auto entries = Read(OpenCvFile(extension, k, d, true), PixelOrigin::kCorner);
      ASSERT_EQ(entries.size(), 1U);
      const CameraModel& model = entries[0].model;
      ExpectK(model, 535.9, 536.1, 342.3 + 0.5, 235.6 + 0.5);
      EXPECT_EQ(entries[0].width_px, 640);
      EXPECT_EQ(entries[0].height_px, 480);
      const std::vector<double> expected{model.k1, model.k2, model.p1, model.p2,
                                         model.k3, model.k4, model.k5, model.k6};
      for (int i = 0; i < 8; ++i)
        EXPECT_EQ(expected[static_cast<std::size_t>(i)], i < count ? all[static_cast<std::size_t>(i)] : 0) << i;
      EXPECT_EQ(model.kind, count == 4 ? CameraModelKind::kOpenCv : CameraModelKind::kFullOpenCv);
    }
}

TEST_F(Calibration, OpenCvMistakes) {
  const cv::Mat k = (cv::Mat_<double>(3, 3) << 535.9, 0, 342.3, 0, 536.1, 235.6, 0, 0, 1);
  EXPECT_THAT(Mistake(OpenCvFile(".yml", k, cv::Mat::zeros(1, 14, CV_64F), true)),
              HasSubstr("14 coefficients) is not supported"));
  EXPECT_THAT(Mistake(OpenCvFile(".yml", k, cv::Mat::zeros(1, 12, CV_64F), true)),
              HasSubstr("12 coefficients) is not supported"));
  EXPECT_THAT(Mistake(OpenCvFile(".yml", k, cv::Mat::zeros(1, 3, CV_64F), true)),
              HasSubstr("3 distortion coefficients"));
  EXPECT_THAT(Mistake(OpenCvFile(".yml", cv::Mat::eye(2, 3, CV_64F), cv::Mat::zeros(1, 5, CV_64F), true)),
              HasSubstr("6 numbers, not 9"));
  EXPECT_THAT(Mistake(OpenCvFile(".yml", -k, cv::Mat::zeros(1, 5, CV_64F), true)), HasSubstr("is not fx 0 cx"));
  EXPECT_THAT(Mistake(OpenCvFile(".yml", k, cv::Mat::zeros(1, 4, CV_64F), true) + "fisheye_model: 1\n"),
              HasSubstr("fisheye"));
  EXPECT_THAT(Mistake(OpenCvFile(".yml", k, cv::Mat::zeros(1, 4, CV_64F), true) + "distortion_model: equidistant\n"),
              HasSubstr("'equidistant'"));
  EXPECT_THAT(Mistake("%YAML:1.0\n---\na: [1, 2"), HasSubstr("not valid OpenCV"));
  EXPECT_THAT(Mistake("%YAML:1.0\n---\na: 1\n"), HasSubstr("without a camera matrix"));
  EXPECT_THAT(
      Mistake("<?xml version=\"1.0\"?>\n<opencv_storage>\n<imagelist>\"left01.jpg\"</imagelist>\n</opencv_storage>\n"),
      HasSubstr("without a camera matrix"));
  EXPECT_THAT(Mistake("%YAML:1.0\n---\nimage_width: -3\nimage_height: 4\n"),
              HasSubstr("'image_width' is not an image size"));
}

TEST(CalibrationOfRealData, EachIsRead) {
  if (DataFolder().empty()) GTEST_SKIP() << "RILIEVO_DATA is not set";
  const auto read = [](const char* name) { return ReadCalibration(DataFolder() / name, PixelOrigin::kCorner); };
  ExpectK(read("strecha/fountain-P11/images/K.txt").at(0).model, 2759.48, 2764.16, 1520.69, 1006.81);
  ExpectK(read("temple47/K.txt").at(0).model, 1520.4, 1525.9, 302.32, 246.87);
  EXPECT_EQ(read("cyprus10/cameras.txt").size(), 2U);
  EXPECT_EQ(read("opencv/left_intrinsics.yml").at(0).width_px, 640);
  EXPECT_EQ(read("opencv/intrinsics.yml").size(), 2U);
  EXPECT_THAT(ErrorOf([&] { read("opencv/stereo_calib.xml"); }), HasSubstr("without a camera matrix"));
  EXPECT_THAT(ErrorOf([&] { read("opencv/left01.jpg"); }), HasSubstr("binary file"));
}

}  // namespace
}  // namespace rilievo::io
