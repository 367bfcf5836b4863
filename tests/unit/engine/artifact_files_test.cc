// Every file of a store is told apart: artifacts in their places from all else that may lie there.
#include "engine/artifact_files.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <map>

namespace rilievo::engine {
namespace {

namespace fs = std::filesystem;
using Kind = StoredFile::Kind;

class ArtifactFiles : public ::testing::Test {
 protected:
  ~ArtifactFiles() override { fs::remove_all(root_); }
  void Put(const std::string& name, const std::string& text) {
    fs::create_directories((root_ / name).parent_path());
    std::ofstream(root_ / name) << text;
  }
  std::map<std::string, StoredFile> Found() {
    std::map<std::string, StoredFile> found;
    for (const StoredFile& file : FilesOf(store_)) found[file.path.lexically_relative(root_).generic_string()] = file;
    return found;
  }
  fs::path root_ = fs::temp_directory_path() / ("rilievo-files-" + std::to_string(::getpid()));
  ArtifactStore store_{root_};
};

TEST_F(ArtifactFiles, AreToldApart) {
  ArtifactKey key{"features", {}};
  key.digest.bytes[0] = 0xab;
  const std::vector<std::byte> payload(100);
  store_.Publish(key, payload);
  const std::string name = store_.PathOf(key).lexically_relative(root_).generic_string();
  const std::string hex = key.digest.Hex();
  Put("features/00/" + hex + ".art", "in the wrong folder");
  Put("features/ab/notes.txt", "a");
  Put("Photos/ab/" + hex + ".art", "no stage has this name");
  Put("quarantine/features-" + hex + ".art", "bc");
  const std::string old = "features/ab/x.art.tmp-00000000-7-1-00000000",
                    young = "features/ab/x.art.tmp-00000000-7-2-00000000";
  Put(old, "d");
  Put(young, "e");
  fs::last_write_time(root_ / old, fs::file_time_type::clock::now() - std::chrono::hours(30));

  const auto found = Found();
  ASSERT_EQ(found.size(), 7u);
  EXPECT_EQ(found.at(name).kind, Kind::kArtifact);
  EXPECT_EQ(found.at(name).key, key);
  EXPECT_EQ(found.at(name).bytes, 140u);
  EXPECT_EQ(found.at("features/00/" + hex + ".art").kind, Kind::kOther);
  EXPECT_EQ(found.at("features/ab/notes.txt").kind, Kind::kOther);
  EXPECT_EQ(found.at("Photos/ab/" + hex + ".art").kind, Kind::kOther);
  EXPECT_EQ(found.at("quarantine/features-" + hex + ".art").kind, Kind::kQuarantined);
  EXPECT_EQ(found.at(old).kind, Kind::kStale);
  EXPECT_EQ(found.at(young).kind, Kind::kTemporary);
}

TEST_F(ArtifactFiles, AStoreForCheckingMovesNothing) {
  const ArtifactKey key{"pairs", {}};
  store_.Publish(key, std::vector<std::byte>(10));
  fs::resize_file(store_.PathOf(key), 45);
  const ArtifactStore reader = ArtifactStore::ForChecking(root_);
  EXPECT_FALSE(reader.Read(key));
  EXPECT_TRUE(fs::exists(store_.PathOf(key)));
  EXPECT_FALSE(store_.Read(key));
  EXPECT_FALSE(fs::exists(store_.PathOf(key)));
}

TEST(ArtifactFilesOfNothing, AreNone) {
  EXPECT_TRUE(FilesOf(ArtifactStore::ForReading("/nonexistent/rilievo")).empty());
}

}  // namespace
}  // namespace rilievo::engine
