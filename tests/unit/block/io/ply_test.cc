// PLY export, read back by a small reader of the published header grammar.
#include "block/io/ply.h"

#include <gtest/gtest.h>

#include <cstring>
#include <map>
#include <sstream>

#include "tests/unit/block/io/small_block.h"

namespace rilievo::io {
namespace {

using Vertex = std::map<std::string, double>;

std::vector<Vertex> ReadPly(const std::string& content) {
  std::istringstream in(content);
  std::string line;
  bool binary = false;
  std::size_t count = 0;
  std::vector<std::pair<std::string, std::string>> properties;  // name, type
  while (std::getline(in, line) && line != "end_header") {
    std::istringstream words(line);
    std::string key, a, b;
    words >> key >> a >> b;
    if (key == "format") binary = a == "binary_little_endian";
    if (key == "element") count = std::stoul(b);
    if (key == "property") properties.emplace_back(b, a);
  }
  std::vector<Vertex> vertices(count);
  for (auto& vertex : vertices)
    for (const auto& [name, type] : properties) {
      if (!binary) {
        in >> vertex[name];
      } else if (type == "double") {
        double value = 0;
        in.read(reinterpret_cast<char*>(&value), 8);
        vertex[name] = value;
      } else if (type == "int") {
        std::int32_t value = 0;
        in.read(reinterpret_cast<char*>(&value), 4);
        vertex[name] = value;
      } else {
        vertex[name] = static_cast<unsigned char>(in.get());
      }
      EXPECT_TRUE(in.good() || (!binary && in.eof()));
    }
  if (!binary) in >> std::ws;
  EXPECT_EQ(in.peek(), std::char_traits<char>::eof());
  return vertices;
}

TEST(Ply, ReadsBackExactlyInBothForms) {
  const SmallBlock truth = MakeSmallBlock({TestCamera(CameraModelKind::kOpenCv)});
  for (const PlyForm form : {PlyForm::kText, PlyForm::kBinary}) {
    const FileSet files = Ply(truth.block, truth.model, form);
    const auto points = ReadPly(files.at("points.ply"));
    ASSERT_EQ(points.size(), truth.model.points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Point& point = truth.model.points[i];
      const Vertex& vertex = points[i];
      EXPECT_EQ(Eigen::Vector3d(vertex.at("x"), vertex.at("y"), vertex.at("z")), point.position);
      EXPECT_EQ(vertex.at("green"), point.color[1]);
      EXPECT_EQ(vertex.at("rays"), static_cast<double>(point.observations.size()));
      double sum = 0;
      for (const auto& o : point.observations) sum += o.residual_px.squaredNorm();
      const double rms =
          point.observations.empty() ? 0 : std::sqrt(sum / static_cast<double>(point.observations.size()));
      EXPECT_NEAR(vertex.at("rms_px"), rms, 1e-9);
    }
    const auto cameras = ReadPly(files.at("cameras.ply"));
    ASSERT_EQ(cameras.size(), truth.model.cam_from_world.size());
    auto camera = cameras.begin();
    for (const auto& [id, pose] : truth.model.cam_from_world) {
      EXPECT_EQ(camera->at("image"), id.value);
      const Eigen::Vector3d center(camera->at("x"), camera->at("y"), camera->at("z")),
          direction(camera->at("nx"), camera->at("ny"), camera->at("nz"));
      EXPECT_LT((pose * center).norm(), 1e-12);
      EXPECT_LT((pose * (center + direction) - Eigen::Vector3d(0, 0, 1)).norm(), 1e-12);
      ++camera;
    }
  }
}

TEST(Ply, EmptyModelIsAValidFile) {
  const SmallBlock truth = MakeSmallBlock({TestCamera(CameraModelKind::kPinhole)}, 2, 0);
  EXPECT_TRUE(ReadPly(Ply(truth.block, Model{}, PlyForm::kText).at("points.ply")).empty());
}

}  // namespace
}  // namespace rilievo::io
