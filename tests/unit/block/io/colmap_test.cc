// COLMAP export: what is written reads back to the bit, in both forms.
#include "block/io/colmap.h"

#include <gtest/gtest.h>

#include "block/io/residuals.h"
#include "tests/unit/block/io/scratch_folder.h"
#include "tests/unit/block/io/small_block.h"

namespace rilievo::io {
namespace {

constexpr std::array kKinds{CameraModelKind::kSimplePinhole, CameraModelKind::kPinhole, CameraModelKind::kSimpleRadial,
                            CameraModelKind::kRadial,        CameraModelKind::kOpenCv,  CameraModelKind::kFullOpenCv};

std::vector<CameraModel> AllCameras() {
  std::vector<CameraModel> cameras;
  for (const auto kind : kKinds) cameras.push_back(TestCamera(kind));
  return cameras;
}

void ExpectSameModel(const SmallBlock& truth, const ColmapModel& read) {
  ASSERT_EQ(read.model.cam_from_world.size(), truth.model.cam_from_world.size());
  std::vector<ImageId> written;
  for (const auto& [id, pose] : truth.model.cam_from_world) {
    const ImageId read_id(static_cast<std::uint32_t>(written.size()));
    written.push_back(id);
    EXPECT_EQ(read.block.image(read_id).name, truth.block.image(id).name);
    EXPECT_EQ(read.model.cam_from_world.at(read_id).rotation.coeffs(), pose.rotation.coeffs());
    EXPECT_EQ(read.model.cam_from_world.at(read_id).translation, pose.translation);
    const Camera& a = truth.block.camera_of(id);
    const Camera& b = read.block.camera_of(read_id);
    EXPECT_EQ(a.model.kind, b.model.kind);
    EXPECT_EQ(a.width_px, b.width_px);
    const Eigen::Vector3d x(0.1, -0.2, 1.1);
    EXPECT_EQ(*a.model.Project(x), *b.model.Project(x));
  }
  ASSERT_EQ(read.model.points.size(), truth.model.points.size());
  double largest = 0;
  for (std::size_t p = 0; p < truth.model.points.size(); ++p) {
    const Point& a = truth.model.points[p];
    const Point& b = read.model.points[p];
    EXPECT_EQ(a.position, b.position);
    EXPECT_EQ(a.color, b.color);
    ASSERT_EQ(a.observations.size(), b.observations.size());
    for (std::size_t o = 0; o < a.observations.size(); ++o) {
      EXPECT_EQ(written[b.observations[o].feature.image.value], a.observations[o].feature.image);
      EXPECT_EQ(a.observations[o].measured_px, b.observations[o].measured_px);
      largest = std::max(largest, (a.observations[o].residual_px - b.observations[o].residual_px).norm());
    }
  }
  EXPECT_LT(largest, 1e-6);
}

TEST(Colmap, TextReadsBackExactly) {
  const SmallBlock truth = MakeSmallBlock(AllCameras(), 9);
  ExpectSameModel(truth, ReadColmap(ColmapText(truth.block, truth.model)));
}

TEST(Colmap, BinaryReadsBackExactly) {
  const SmallBlock truth = MakeSmallBlock(AllCameras(), 9);
  ExpectSameModel(truth, ReadColmap(ColmapBinary(truth.block, truth.model)));
}

TEST(Colmap, ParametersBeyondTheKindPromoteIt) {
  CameraModel camera = TestCamera(CameraModelKind::kSimpleRadial);
  camera.fy += 1;
  const SmallBlock truth = MakeSmallBlock({camera});
  const ColmapModel read = ReadColmap(ColmapText(truth.block, truth.model));
  EXPECT_EQ(read.block.cameras[0].model.kind, CameraModelKind::kOpenCv);
  EXPECT_EQ(read.block.cameras[0].model.fy, camera.fy);
}

// Layout by hand: the published format of the first records, not our reader's opinion of them.
TEST(Colmap, BinaryLayoutIsThePublishedOne) {
  const SmallBlock truth = MakeSmallBlock({TestCamera(CameraModelKind::kPinhole)}, 2, 1);
  const FileSet files = ColmapBinary(truth.block, truth.model);
  const std::string& cameras = files.at("cameras.bin");
  ASSERT_EQ(cameras.size(), 8 + 4 + 4 + 8 + 8 + 4 * 8U);
  const auto u32 = [](const std::string& s, std::size_t at) {
    std::uint32_t v;
    std::memcpy(&v, s.data() + at, 4);
    return v;
  };
  EXPECT_EQ(u32(cameras, 0), 1U);
  EXPECT_EQ(u32(cameras, 8), 1U);   // id
  EXPECT_EQ(u32(cameras, 12), 1U);  // PINHOLE
  EXPECT_EQ(u32(cameras, 16), 4000U);
  std::size_t observations = 0;
  for (const Point& point : truth.model.points) observations += point.observations.size();
  const std::size_t name = truth.block.images[0].name.size() + 1;
  EXPECT_EQ(files.at("images.bin").size(), 8 + 2 * (4 + 56 + 4 + name + 8) + observations * 24);
  EXPECT_EQ(files.at("points3D.bin").size(), 8 + 8 + 24 + 3 + 8 + 8 + observations * 8);
}

TEST(Colmap, TextHasTwoLinesAnImageAndIdsFromOne) {
  const SmallBlock truth = MakeSmallBlock({TestCamera(CameraModelKind::kPinhole)}, 2, 0);
  const FileSet files = ColmapText(truth.block, truth.model);
  EXPECT_NE(files.at("cameras.txt").find("\n1 PINHOLE 4000 3000 4400.125 4411.3 2003.1 1490.7\n"), std::string::npos);
  EXPECT_NE(files.at("images.txt").find(" 1 left side/\xC3\xA4 1.jpg\n\n"), std::string::npos);
}

TEST(Colmap, DamageIsNamedWithItsPlace) {
  const SmallBlock truth = MakeSmallBlock({TestCamera(CameraModelKind::kPinhole)});
  FileSet text = ColmapText(truth.block, truth.model);
  text["points3D.txt"] += "9999 1 2 nan 0 0 0 0.1\n";
  EXPECT_NE(ErrorOf([&] { ReadColmap(text); }).find("points3D.txt: line"), std::string::npos);
  text = ColmapText(truth.block, truth.model);
  text["cameras.txt"] = "";
  EXPECT_NE(ErrorOf([&] { ReadColmap(text); }).find("camera 1, which is missing"), std::string::npos);
  const FileSet binary = ColmapBinary(truth.block, truth.model);
  for (const auto& [name, bytes] : binary)
    for (const std::size_t keep : {std::size_t{0}, std::size_t{9}, bytes.size() - 1}) {
      FileSet cut = binary;
      cut[name].resize(keep);
      EXPECT_NE(ErrorOf([&] { ReadColmap(cut); }).find(name), std::string::npos);
    }
  FileSet longer = binary;
  longer["images.bin"] += 'x';
  EXPECT_NE(ErrorOf([&] { ReadColmap(longer); }).find("after its end"), std::string::npos);
  EXPECT_NE(ErrorOf([] { ReadColmap({}); }).find("no COLMAP model"), std::string::npos);
}

}  // namespace
}  // namespace rilievo::io
