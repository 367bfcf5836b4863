// What is written reads back with other libraries and agrees with the renderer.
#include "simulation/writer.h"

#include <gtest/gtest.h>

#include <exiv2/exiv2.hpp>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "simulation/scene_source.h"

namespace rilievo::simulation {
namespace {

namespace fs = std::filesystem;

class WriterTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) /
              ("scène " + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
    fs::remove_all(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  static SceneOptions Options(const std::string& format, int bits) {
    SceneOptions options;
    options.images = 3;
    options.width_px = 200;
    options.height_px = 150;
    options.surface_points = 3000;
    options.format = format;
    options.bits = std::to_string(bits);
    return options;
  }
  fs::path folder_;
};

std::string ReadText(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

TEST_F(WriterTest, ImagesHoldTheRenderedPixelsAndExif) {
  for (const auto& [format, bits] : {std::pair{"jpg", 8}, {"png", 8}, {"tif", 8}, {"png", 16}, {"tif", 16}}) {
    const Renderer renderer(MakeScene(Options(format, bits)));
    WriteSceneImage(renderer, 1, folder_, {});
    const fs::path path = folder_ / "images" / renderer.scene().names[1];
    const cv::Mat read = cv::imread(path.string(), cv::IMREAD_UNCHANGED | cv::IMREAD_IGNORE_ORIENTATION);
    const GreyImage image = renderer.RenderGrey(1);
    ASSERT_EQ(read.type(), bits == 16 ? CV_16UC1 : CV_8UC1) << format;
    ASSERT_EQ(read.size(), cv::Size(200, 150));
    double worst = 0;
    for (int i = 0; i < 200 * 150; ++i) {
      const double got =
          bits == 16 ? read.at<std::uint16_t>(i / 200, i % 200) : read.at<std::uint8_t>(i / 200, i % 200);
      worst = std::max(worst, std::abs(got - (bits == 16 ? image.u16[i] : image.u8[i])));
    }
    EXPECT_LE(worst, std::string(format) == "jpg" ? 6 : 0) << format << bits;
    const auto file = Exiv2::ImageFactory::open(path.string());
    file->readMetadata();
    Exiv2::ExifData& exif = file->exifData();
    const ExifData expected = SceneExif(renderer.scene(), 1);
    EXPECT_EQ(exif["Exif.Image.Make"].toString(), "Rilievo") << format;
    EXPECT_NEAR(exif["Exif.Photo.FocalLength"].toFloat(), expected.focal_mm, 1e-3);
    EXPECT_EQ(exif["Exif.Photo.DateTimeOriginal"].toString(), expected.date_time);
    EXPECT_NEAR(expected.focal_mm * expected.focal_plane_x_res_per_mm, renderer.scene().camera.model.fx, 0.01);
  }
}

TEST_F(WriterTest, AWholeBlockHasItsTruthBesideIt) {
  WriteOptions options;
  options.depth = true;
  options.points = 200;
  const Scene scene = MakeScene(Options("png", 8));
  const Renderer renderer(scene);
  WriteSceneData(renderer, folder_, options);
  for (const fs::path& path : SceneDataPaths(folder_)) EXPECT_TRUE(fs::is_regular_file(path)) << path;
  for (std::size_t i = 0; i < scene.names.size(); ++i) WriteMissing(renderer, i, folder_, options);

  std::istringstream poses(ReadText(folder_ / "truth" / "poses.txt"));
  std::string line;
  std::size_t read = 0;
  while (std::getline(poses, line)) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream fields(line);
    int id = 0, camera = 0;
    double qw = 0, qx = 0, qy = 0, qz = 0, tx = 0, ty = 0, tz = 0;
    std::string name;
    fields >> id >> qw >> qx >> qy >> qz >> tx >> ty >> tz >> camera >> name;
    EXPECT_EQ(Eigen::Quaterniond(qw, qx, qy, qz).coeffs(), scene.cam_from_world[read].rotation.coeffs());
    EXPECT_EQ(Eigen::Vector3d(tx, ty, tz), scene.cam_from_world[read].translation);
    EXPECT_EQ(name, scene.names[read++]);
  }
  EXPECT_EQ(read, 3U);

  std::istringstream points(ReadText(folder_ / "truth" / "points.txt"));
  int rays = 0;
  while (std::getline(points, line)) {
    if (line[0] == '#') continue;
    std::istringstream fields(line);
    Eigen::Vector3d position;
    int id = 0, count = 0;
    fields >> id >> position.x() >> position.y() >> position.z() >> count;
    for (int k = 0; k < count; ++k, ++rays) {
      std::string name;
      Eigen::Vector2d pixel;
      fields >> name >> pixel.x() >> pixel.y();
      const auto image =
          static_cast<std::size_t>(std::find(scene.names.begin(), scene.names.end(), name) - scene.names.begin());
      EXPECT_LT((*renderer.Project(image, position) - pixel).norm(), 1e-9);
      EXPECT_TRUE(renderer.Visible(position, image));
    }
  }
  EXPECT_GT(rays, 400);

  const std::string pfm = ReadText(folder_ / "truth" / "depth" / "image_0001.png.pfm"), head = "Pf\n200 150\n-1.0\n";
  ASSERT_EQ(pfm.size(), head.size() + 4 * 200 * 150);
  EXPECT_EQ(pfm.substr(0, head.size()), head);
  float first_of_last_row = 0;
  std::memcpy(&first_of_last_row, pfm.data() + head.size(), 4);
  EXPECT_EQ(first_of_last_row, renderer.RenderDepth(0).depth_m[149 * 200]);
  EXPECT_EQ(ReadText(folder_ / "truth" / "surface.ply").substr(0, 40), "ply\nformat binary_little_endian 1.0\ncomm");
  EXPECT_NE(ReadText(folder_ / "calibration.toml").find("model = \"OPENCV\""), std::string::npos);
}

TEST_F(WriterTest, AFolderThatCannotBeMadeIsAnError) {
  fs::create_directories(folder_);
  std::ofstream(folder_ / "images") << "a file where a folder must be";
  const Renderer renderer(MakeScene(Options("png", 8)));
  EXPECT_THROW(WriteSceneImage(renderer, 0, folder_, {}), Error);
}

}  // namespace
}  // namespace rilievo::simulation
