// Scenes are laid out as promised and survive their file; broken files are one-line errors.
#include "simulation/scene.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "simulation/ray_grid.h"

namespace rilievo::simulation {
namespace {

SceneOptions Options(const std::string& surface, const std::string& network) {
  SceneOptions options;
  options.surface = surface;
  options.network = network;
  options.width_px = 600;
  options.height_px = 400;
  options.surface_points = 2000;
  return options;
}

TEST(Scene, EveryNetworkOfEverySurfaceLooksAtTheObject) {
  for (const char* surface : {"relief", "sphere", "statue"})
    for (const char* network : {"arc", "strip", "ring", "random"}) {
      const Scene scene = MakeScene(Options(surface, network));
      ASSERT_EQ(scene.names.size(), 12U);
      for (const Rigid3& pose : scene.cam_from_world) {
        EXPECT_NEAR(pose.rotation.norm(), 1, 1e-12);
        const Eigen::Vector3d axis = pose.rotation.conjugate() * Eigen::Vector3d::UnitZ();
        if (std::string(network) != "strip") {
          EXPECT_LT(axis.cross(-pose.Center()).norm(), 0.15) << surface << " " << network;  // passes near the middle
        }
        EXPECT_GT(axis.dot(pose.Center()), -1.3 * pose.Center().norm());
        const Eigen::Vector3d up = pose.rotation * Eigen::Vector3d::UnitY();
        EXPECT_LT(up.y(), -0.5) << "images stand upright";
      }
    }
}

TEST(Scene, IsAFunctionOfItsOptions) {
  const SceneOptions options = Options("relief", "random");
  EXPECT_EQ(SceneText(MakeScene(options)), SceneText(MakeScene(options)));
  SceneOptions other = options;
  other.seed = 2;
  EXPECT_NE(SceneText(MakeScene(options)), SceneText(MakeScene(other)));
}

TEST(Scene, SurvivesItsFileBitByBit) {
  const auto path = std::filesystem::path(testing::TempDir()) / "scene_round_trip.json";
  for (const char* network : {"arc", "ring"}) {
    const Scene scene = MakeScene(Options("relief", network));
    WriteSceneFile(scene, path);
    EXPECT_TRUE(IsSceneFile(path));
    const Scene back = ReadSceneFile(path);
    EXPECT_EQ(SceneText(back), SceneText(scene));
    for (std::size_t i = 0; i < scene.names.size(); ++i) {
      EXPECT_EQ(back.cam_from_world[i].rotation.coeffs(), scene.cam_from_world[i].rotation.coeffs());
      EXPECT_EQ(back.cam_from_world[i].translation, scene.cam_from_world[i].translation);
      EXPECT_EQ(back.exposures[i], scene.exposures[i]);
    }
    EXPECT_EQ(back.panel_m, scene.panel_m);
    EXPECT_EQ(back.camera.model.k1, scene.camera.model.k1);
  }
  std::filesystem::remove(path);
}

std::string Replaced(std::string text, const std::string& what, const std::string& by) {
  const auto at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return text.replace(at, what.size(), by);
}

TEST(Scene, BrokenFilesAreOneLineErrors) {
  const std::string good = SceneText(MakeScene(Options("relief", "arc")));
  const std::pair<std::string, ErrorCode> cases[] = {
      {"", ErrorCode::kInvalidInput},
      {"\xff\xd8\xff", ErrorCode::kInvalidInput},
      {"[1, 2]", ErrorCode::kInvalidInput},
      {"{\"format\": \"something\"}", ErrorCode::kInvalidInput},
      {good.substr(0, good.size() / 2), ErrorCode::kInvalidInput},
      {Replaced(good, "\"version\": 2", "\"version\": 99"), ErrorCode::kVersion},
      {Replaced(good, "\"width-px\": 600", "\"width-px\": -600"), ErrorCode::kInvalidInput},
      {Replaced(good, "\"width-px\": 600", "\"width-px\": 1e300"), ErrorCode::kInvalidInput},
      {Replaced(good, "\"width-px\": 600", "\"width-px\": \"wide\""), ErrorCode::kInvalidInput},
      {Replaced(good, "\"noise\"", "\"noize\""), ErrorCode::kInvalidInput},
      {Replaced(good, "\"bits\": \"8\"", "\"bits\": \"12\""), ErrorCode::kInvalidInput},
      {Replaced(good, "\"bits\": \"8\"", "\"bits\": 8"), ErrorCode::kInvalidInput},
      {Replaced(good, "\"OPENCV\"", "\"HOLGA\""), ErrorCode::kInvalidInput},
      {Replaced(good, "\"k1\": -0.06", "\"k1\": -60.0"), ErrorCode::kInvalidInput},
      {Replaced(good, "image_0002.jpg", "image_0001.jpg"), ErrorCode::kInvalidInput},
      {Replaced(good, "image_0002.jpg", "../image.jpg"), ErrorCode::kInvalidInput},
      {Replaced(good, "\"translation_m\": [", "\"translation_m\": [1.0,"), ErrorCode::kInvalidInput},
      {Replaced(good, "\"images\": 12", "\"images\": 13"), ErrorCode::kInvalidInput},
  };
  for (const auto& [text, code] : cases) {
    try {
      ParseScene(text, "there/scene.json");
      ADD_FAILURE() << "accepted: " << text.substr(0, 60);
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), code) << error.what();
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
      EXPECT_EQ(std::string(error.what()).find("there/scene.json: "), 0U) << error.what();
    }
  }
  EXPECT_THROW(ReadSceneFile(std::filesystem::path(testing::TempDir()) / "no such scene"), Error);
  EXPECT_THROW(ReadSceneFile(testing::TempDir()), Error);
  EXPECT_FALSE(IsSceneFile(testing::TempDir()));
}

TEST(Scene, ContradictoryOptionsAreUsageErrors) {
  const auto code = [](auto change) {
    SceneOptions options = Options("sphere", "arc");
    change(options);
    try {
      MakeScene(options);
    } catch (const Error& error) {
      return error.code();
    }
    return ErrorCode::kInternal;
  };
  EXPECT_EQ(code([](SceneOptions& o) { o.bits = "16"; }), ErrorCode::kUsage);
  EXPECT_EQ(code([](SceneOptions& o) { o.bits = "12"; }), ErrorCode::kUsage);
  EXPECT_EQ(code([](SceneOptions& o) { o.distance_m = 0.5; }), ErrorCode::kUsage);
  EXPECT_EQ(code([](SceneOptions& o) { o.surface = "cube"; }), ErrorCode::kUsage);
  EXPECT_EQ(code([](SceneOptions& o) { o.strips = 13; }), ErrorCode::kUsage);
}

TEST(Scene, WarnsOfRingsWithWideSteps) {
  const auto warnings = [](const char* surface, const char* network, int images) {
    SceneOptions options = Options(surface, network);
    options.images = images;
    return SceneWarnings(options);
  };
  ASSERT_EQ(warnings("sphere", "ring", 23).size(), 1U);
  EXPECT_NE(warnings("statue", "ring", 12)[0].find("use 24 or more"), std::string::npos);
  EXPECT_TRUE(warnings("sphere", "ring", 24).empty());
  EXPECT_TRUE(warnings("relief", "ring", 4).empty());
  EXPECT_TRUE(warnings("sphere", "arc", 4).empty());
}

TEST(RayGrid, InterpolatesTheInverseDistortion) {
  const Scene scene = MakeScene(Options("relief", "arc"));
  const RayGrid rays(scene.camera);
  std::vector<Eigen::Vector2d> row;
  for (const double y : {0.5, 13.0, 207.3, 399.9}) {
    rays.Row(0.37, y, 599, row);
    for (int x = 0; x < 599; ++x) {
      const Eigen::Vector2d exact = *scene.camera.model.Normalize({x + 0.37, y});
      ASSERT_LT((row[x] - exact).norm() * scene.camera.model.fx, 1e-4);
      ASSERT_LT((rays.At(x + 0.37, y) - exact).norm() * scene.camera.model.fx, 1e-4);
    }
  }
}

}  // namespace
}  // namespace rilievo::simulation
