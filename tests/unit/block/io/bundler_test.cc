// Bundler export: the re-read file has the same reprojection errors, by Bundler's own published projection.
#include "block/io/bundler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/block/io/scratch_folder.h"
#include "tests/unit/block/io/small_block.h"

namespace rilievo::io {
namespace {

using testing::HasSubstr;

/// The projection of Bundler's manual from the raw tokens: P = RX + t, p = -P/P.z, p' = f r(p) p; y up, about the
/// middle.
Eigen::Vector2d BundlerProjection(const std::string& content, std::size_t camera, const Eigen::Vector3d& x) {
  std::istringstream in(content.substr(content.find('\n')));
  std::size_t cameras = 0, points = 0;
  in >> cameras >> points;
  std::array<double, 15> v{};
  for (std::size_t c = 0; c <= camera; ++c)
    for (double& value : v) in >> value;
  const Eigen::Matrix3d r = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(v.data() + 3);
  const Eigen::Vector3d p3 = r * x + Eigen::Vector3d(v[12], v[13], v[14]);
  const Eigen::Vector2d p = -p3.head<2>() / p3.z();
  const double r2 = p.squaredNorm();
  return v[0] * (1 + v[1] * r2 + v[2] * r2 * r2) * p;
}

void ExpectSameResiduals(const SmallBlock& truth, double focal_scale) {
  const FileSet files = BundlerText(truth.block, truth.model);
  const BundlerScene scene = ReadBundler("bundle.out", files.at("bundle.out"));
  ASSERT_EQ(scene.cameras.size(), truth.block.images.size());
  ASSERT_EQ(scene.points.size(), truth.model.points.size());
  EXPECT_EQ(scene.cameras[1].focal_px, 0);  // not oriented
  double largest = 0;
  for (std::size_t p = 0; p < scene.points.size(); ++p) {
    const Point& point = truth.model.points[p];
    EXPECT_EQ(scene.points[p].position, point.position);
    EXPECT_EQ(scene.points[p].color, point.color);
    ASSERT_EQ(scene.points[p].measurements.size(), point.observations.size());
    for (std::size_t o = 0; o < point.observations.size(); ++o) {
      const auto& m = scene.points[p].measurements[o];
      const Observation& observation = point.observations[o];
      EXPECT_EQ(ImageId(m.camera), observation.feature.image);
      EXPECT_EQ(m.key, observation.feature.feature);
      const Eigen::Vector2d up = BundlerProjection(files.at("bundle.out"), m.camera, point.position);
      const Eigen::Vector2d residual = Eigen::Vector2d(up.x(), -up.y()) - m.centered_px;
      // An ideal camera has other pixels: its residual is that of the rays, through f.
      const CameraModel& model = truth.block.camera_of(observation.feature.image).model;
      const Eigen::Vector2d expected =
          focal_scale == 0
              ? observation.residual_px
              : Eigen::Vector2d(model.fx * (*model.Normalize(observation.measured_px + observation.residual_px) -
                                            *model.Normalize(observation.measured_px)));
      largest = std::max(largest, (residual - expected).norm());
    }
  }
  EXPECT_LT(largest, 1e-6);
  for (const auto& [id, pose] : truth.model.cam_from_world) {
    EXPECT_LT((scene.cameras[id.value].cam_from_world.Center() - pose.Center()).norm(), 1e-12);
    EXPECT_LT(scene.cameras[id.value].cam_from_world.rotation.angularDistance(pose.rotation), 1e-12);
  }
}

TEST(Bundler, ItsOwnCameraIsWrittenAsItIs) {
  CameraModel camera = TestCamera(CameraModelKind::kRadial);
  camera.cx = 2000, camera.cy = 1500;
  ExpectSameResiduals(MakeSmallBlock({camera}), 0);
  EXPECT_EQ(
      ReadBundler("b", BundlerText(MakeSmallBlock({camera}).block, MakeSmallBlock({camera}).model).at("bundle.out"))
          .cameras[0]
          .k2,
      camera.k2);
}

TEST(Bundler, OtherCamerasBecomeIdeal) {
  for (const auto kind :
       {CameraModelKind::kPinhole, CameraModelKind::kRadial, CameraModelKind::kOpenCv, CameraModelKind::kFullOpenCv}) {
    const SmallBlock truth = MakeSmallBlock({TestCamera(kind)});
    ExpectSameResiduals(truth, 1);
    EXPECT_EQ(ReadBundler("b", BundlerText(truth.block, truth.model).at("bundle.out")).cameras[0].k1, 0);
  }
}

TEST(Bundler, ListNamesTheImages) {
  const SmallBlock truth = MakeSmallBlock({TestCamera(CameraModelKind::kPinhole)}, 2, 0);
  EXPECT_EQ(BundlerText(truth.block, truth.model).at("list.txt"),
            "left side/\xC3\xA4 0.jpg\nleft side/\xC3\xA4 1.jpg\n");
}

TEST(Bundler, DamageIsAnError) {
  const SmallBlock truth = MakeSmallBlock({TestCamera(CameraModelKind::kPinhole)}, 3, 5);
  const std::string content = BundlerText(truth.block, truth.model).at("bundle.out");
  EXPECT_THAT(ErrorOf([&] { ReadBundler("b.out", "# Bundle file v0.4\n0 0\n"); }), HasSubstr("b.out: does not start"));
  EXPECT_THAT(ErrorOf([&] { ReadBundler("b.out", content + " 7"); }), HasSubstr("goes on"));
  EXPECT_THAT(ErrorOf([&] { ReadBundler("b.out", "# Bundle file v0.3\n999999999 0\n"); }), HasSubstr("out of range"));
  for (std::size_t keep = 0; keep < content.size() - 30; keep += 37)
    EXPECT_FALSE(ErrorOf([&] { ReadBundler("b.out", content.substr(0, keep)); }).empty());
}

TEST(Bundler, ReadsAFileOfAnotherProgram) {
  if (DataFolder().empty()) GTEST_SKIP() << "RILIEVO_DATA is not set";
  const BundlerScene scene = ReadBundler("cameras.out", Slurp(DataFolder() / "temple47/cameras.out"));
  EXPECT_EQ(scene.cameras.size(), 46U);
  EXPECT_EQ(scene.points.size(), 2689U);
  double sum = 0;
  std::size_t count = 0;
  for (const auto& point : scene.points)
    for (const auto& m : point.measurements) {
      const auto& camera = scene.cameras[m.camera];
      const Eigen::Vector2d p = (camera.cam_from_world * point.position).hnormalized();
      const double r2 = p.squaredNorm();
      sum += (camera.focal_px * (1 + r2 * (camera.k1 + r2 * camera.k2)) * p - m.centered_px).squaredNorm();
      ++count;
    }
  EXPECT_LT(std::sqrt(sum / static_cast<double>(count)), 2.0);  // px: signs and origin are right
}

}  // namespace
}  // namespace rilievo::io
