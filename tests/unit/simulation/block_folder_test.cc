// A block folder continues its own scene and refuses everything else, leaving what is there as it was.
#include "simulation/block_folder.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <map>
#include <sstream>

#include "simulation/block_file.h"
#include "simulation/writer.h"

namespace rilievo::simulation {
namespace {

namespace fs = std::filesystem;

Scene SmallScene(int images = 3, int seed = 1) {
  SceneOptions options;
  options.images = images;
  options.width_px = 120;
  options.height_px = 90;
  options.surface_points = 2000;
  options.format = "png";
  options.seed = seed;
  return MakeScene(options);
}

class BlockFolderTest : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = fs::path(testing::TempDir()) /
           ("folder " + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
    fs::remove_all(dir_);
  }
  void TearDown() override { fs::remove_all(dir_); }

  void Put(const fs::path& path, const std::string& text = "something") const {
    fs::create_directories((dir_ / path).parent_path());
    std::ofstream(dir_ / path) << text;
  }
  /// Every file with its bytes.
  std::map<std::string, std::string> Content() const {
    std::map<std::string, std::string> content;
    for (const auto& entry : fs::recursive_directory_iterator(dir_)) {
      if (!entry.is_regular_file()) continue;
      std::ostringstream text;
      text << std::ifstream(entry.path(), std::ios::binary).rdbuf();
      content[entry.path().lexically_relative(dir_).string()] = text.str();
    }
    return content;
  }
  /// Begins a block and writes its first `images` images.
  void WritePart(const Scene& scene, std::size_t images, bool finish = false) const {
    BlockFolder folder(dir_, scene);
    folder.Begin();
    const Renderer renderer(scene);
    for (std::size_t i = 0; i < images; ++i) WriteMissing(renderer, i, dir_, {});
    if (!finish) return;
    WriteSceneData(renderer, dir_, {});
    folder.Finish();
  }
  void ExpectRefused(const Scene& scene, const std::string& word) const {
    const auto before = Content();
    try {
      const BlockFolder folder(dir_, scene);
      ADD_FAILURE() << "accepted";
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
      EXPECT_FALSE(error.hint().empty());
    }
    EXPECT_EQ(Content(), before);
  }
  fs::path dir_;
};

TEST_F(BlockFolderTest, APartialBlockContinuesAndAWholeOneIsFinished) {
  const Scene scene = SmallScene();
  EXPECT_EQ(BlockFolder(dir_, scene).missing_images(), (std::vector<std::size_t>{0, 1, 2}));
  EXPECT_FALSE(fs::exists(dir_)) << "looking makes nothing";
  WritePart(scene, 2);
  EXPECT_FALSE(fs::exists(dir_ / "scene.json")) << "scene.json comes last";
  const BlockFolder partial(dir_, scene);
  EXPECT_FALSE(partial.finished());
  EXPECT_EQ(partial.missing_images(), std::vector<std::size_t>{2});
  WritePart(scene, 3, true);
  EXPECT_TRUE(BlockFolder(dir_, scene).finished());
  EXPECT_TRUE(fs::exists(dir_ / "scene.json"));
  EXPECT_FALSE(fs::exists(dir_ / "scene.json.partial"));
  EXPECT_EQ(SceneText(ReadSceneFile(dir_ / "scene.json")), SceneText(scene));
}

TEST_F(BlockFolderTest, WhatWasRemovedIsMissing) {
  const Scene scene = SmallScene();
  WritePart(scene, 3, true);
  BlockFolder folder(dir_, scene);
  folder.Look(true);
  EXPECT_EQ(folder.missing_images().size(), 3U) << "no depth was written";
  for (const fs::path& path : SceneDataPaths(dir_)) {
    const fs::path aside = dir_ / "aside";
    fs::rename(path, aside);
    EXPECT_FALSE(BlockFolder(dir_, scene).finished()) << path;
    fs::rename(aside, path);
  }
  fs::remove(ImagePath(dir_, scene.names[1]));
  EXPECT_EQ(BlockFolder(dir_, scene).missing_images(), std::vector<std::size_t>{1});
  BlockFolder(dir_, scene).Begin();
  EXPECT_FALSE(fs::exists(dir_ / "scene.json")) << "an unfinished block has no scene.json";
}

TEST_F(BlockFolderTest, AnotherSceneIsRefusedWhetherFinishedOrNot) {
  WritePart(SmallScene(), 1);
  ExpectRefused(SmallScene(2), "--images 3, not 2");
  ExpectRefused(SmallScene(3, 2), "--seed 1, not 2");
  WritePart(SmallScene(), 3, true);
  ExpectRefused(SmallScene(2), "--images 3, not 2");
}

TEST_F(BlockFolderTest, FoldersOfOthersAreRefused) {
  Put("notes.txt");
  ExpectRefused(SmallScene(), "holds other files");
  fs::remove(dir_ / "notes.txt");
  Put("calibration.toml");
  ExpectRefused(SmallScene(), "holds other files");
  fs::remove(dir_ / "calibration.toml");
  Put("scene.json", "{}");
  ExpectRefused(SmallScene(), "is no scene file");
  fs::remove_all(dir_);
  std::ofstream(dir_) << "a file";
  EXPECT_THROW(BlockFolder(dir_, SmallScene()), Error);
}

TEST_F(BlockFolderTest, ForeignFilesInItsOwnFolderAreRefused) {
  const Scene scene = SmallScene();
  WritePart(scene, 3, true);
  Put("images/mine.jpg");
  ExpectRefused(scene, "mine.jpg");
  fs::remove(dir_ / "images/mine.jpg");
  Put("calibration.toml", "mine");
  ExpectRefused(scene, "calibration.toml");
}

TEST_F(BlockFolderTest, LeftoversOfKilledProgramsAreRemovedAndThoseOfRunningOnesKept) {
  const Scene scene = SmallScene();
  WritePart(scene, 1);
  const std::string running = "images/" + scene.names[1] + "." + std::to_string(getpid()) + ".tmp";
  const std::string dead = "images/" + scene.names[2] + ".999999999.tmp";
  Put(running), Put(dead);
  BlockFolder(dir_, scene).Begin();
  EXPECT_TRUE(fs::exists(dir_ / running));
  EXPECT_FALSE(fs::exists(dir_ / dead));
  EXPECT_FALSE(IsTemporary("images/mine.tmp")) << "only its own names";
}

TEST_F(BlockFolderTest, ASceneAloneIsWrittenButNotOverAnUnfinishedBlock) {
  const Scene scene = SmallScene();
  BlockFolder(dir_, scene).WriteSceneOnly();
  EXPECT_EQ(Content().size(), 1U);
  EXPECT_FALSE(BlockFolder(dir_, scene).finished());
  WritePart(scene, 1);
  EXPECT_THROW(BlockFolder(dir_, scene).WriteSceneOnly(), Error);
}

}  // namespace
}  // namespace rilievo::simulation
