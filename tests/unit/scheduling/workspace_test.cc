// A run record comes back as it was written; other folders and versions are refused.
#include "scheduling/workspace.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "scheduling/orient_keys.h"

namespace rilievo::scheduling {
namespace {

namespace fs = std::filesystem;

class WorkspaceTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "rilievo-workspace-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    dir_ = name;
  }
  void TearDown() override { fs::remove_all(dir_); }

  static RunRecord MakeRecord(const fs::path& images) {
    RunRecord record;
    record.images = images;
    record.processor_level = "avx2";
    record.options.network = Network::kSequence;
    record.options.tracks.closed_sequence = true;
    record.options.tracks.reduction_cell_px = 0.1 + 120;
    record.options.matching.ratio = 0.1 + 0.6;  // not a short decimal
    record.options.verification.estimator = "lmeds";
    record.warnings = {"a \"quoted\" warning"};
    record.block.cameras.push_back(
        {.id = CameraId(0),
         .model = {.kind = CameraModelKind::kOpenCv, .fx = 1.0 / 3, .fy = 2759.48, .cx = 1e-300, .cy = 7, .k1 = -0.1},
         .width_px = 30,
         .height_px = 20,
         .source = CalibrationSource::kExif,
         .label = "EXIF"});
    Image image;
    image.id = ImageId(0);
    image.camera_id = CameraId(0);
    image.name = "Übersicht/a b.jpg";
    image.width_px = 30;
    image.height_px = 20;
    image.exif.orientation = 8;
    image.content.bytes[5] = 200;
    image.decode_scratch_bytes = std::uint64_t{1} << 40;
    image.mask = MaskFile{"Übersicht/a b.png", {}, 123};
    image.mask->content.bytes[7] = 99;
    record.block.images.push_back(image);
    record.block.quarantined.push_back({"x.jpg", "empty"});
    return record;
  }

  fs::path dir_;
};

TEST_F(WorkspaceTest, RecordComesBack) {
  const RunRecord record = MakeRecord(dir_ / "photos");
  Workspace::OpenOrCreate(dir_ / "w").WriteRecord(record);
  const auto read = Workspace::Open(dir_ / "w").ReadRecord();
  ASSERT_TRUE(read);
  EXPECT_EQ(read->images, record.images);
  EXPECT_EQ(read->warnings, record.warnings);
  EXPECT_EQ(read->block.images[0].name, record.block.images[0].name);
  EXPECT_EQ(read->block.images[0].exif.orientation, 8);
  EXPECT_EQ(read->block.cameras[0].source, CalibrationSource::kExif);
  EXPECT_EQ(read->block.images[0].decode_scratch_bytes, std::uint64_t{1} << 40);
  ASSERT_TRUE(read->block.images[0].mask);
  EXPECT_EQ(read->block.images[0].mask->name, "Übersicht/a b.png");
  EXPECT_EQ(read->block.images[0].mask->content.bytes[7], 99);
  EXPECT_EQ(read->block.quarantined[0].reason, "empty");
  // Every bit that results depend on is there: the keys are the same.
  EXPECT_EQ(ComputeKeys(read->block, read->options, read->processor_level).orientation,
            ComputeKeys(record.block, record.options, record.processor_level).orientation);
}

TEST_F(WorkspaceTest, ListedPairsComeBackAndAreChecked) {
  RunRecord record = MakeRecord(dir_);
  for (const char* name : {"b.jpg", "c.jpg"}) {
    record.block.images.push_back(record.block.images[0]);
    record.block.images.back().name = name;
  }
  record.options.network = Network::kSpatial;
  record.options.pairs.max_distance_m = 12.25;
  record.options.listed = {{ImageId(0), ImageId(2)}, {ImageId(1), ImageId(2)}};
  Workspace::OpenOrCreate(dir_ / "w").WriteRecord(record);
  const auto read = Workspace::Open(dir_ / "w").ReadRecord();
  ASSERT_TRUE(read);
  EXPECT_EQ(read->options.network, Network::kSpatial);
  EXPECT_EQ(read->options.pairs.max_distance_m, 12.25);
  EXPECT_EQ(read->options.listed, record.options.listed);
  auto json = nlohmann::json::parse(std::ifstream(dir_ / "w/run.json"));
  for (const char* wrong : {"0 3", "2 1", "1 1"}) {
    json["options"]["listed_pairs"] = wrong;
    std::ofstream(dir_ / "w/run.json") << json;
    EXPECT_THROW(Workspace::Open(dir_ / "w").ReadRecord(), Error) << wrong;
  }
}

TEST_F(WorkspaceTest, RecordsOfBeforeBlockTypesHadOptionsAreRead) {
  Workspace::OpenOrCreate(dir_ / "w").WriteRecord(MakeRecord(dir_));
  auto json = nlohmann::json::parse(std::ifstream(dir_ / "w/run.json"));
  json["options"].erase("pairs");
  json["options"].erase("listed_pairs");
  std::ofstream(dir_ / "w/run.json") << json;
  const auto read = Workspace::Open(dir_ / "w").ReadRecord();
  ASSERT_TRUE(read);
  EXPECT_EQ(read->options.network, Network::kSequence);
  EXPECT_TRUE(read->options.listed.empty());
}

TEST_F(WorkspaceTest, RecordsOfBeforeMasksAreRead) {
  Workspace::OpenOrCreate(dir_ / "w").WriteRecord(MakeRecord(dir_));
  auto json = nlohmann::json::parse(std::ifstream(dir_ / "w/run.json"));
  json["image_list"][0].erase("mask");
  json["image_list"][0].erase("decode_scratch_bytes");
  std::ofstream(dir_ / "w/run.json") << json;
  const auto read = Workspace::Open(dir_ / "w").ReadRecord();
  ASSERT_TRUE(read);
  EXPECT_FALSE(read->block.images[0].mask);
}

TEST_F(WorkspaceTest, ImagesAreRelativeSoThatBothMayMoveTogether) {
  fs::create_directories(dir_ / "a/photos");
  Workspace::OpenOrCreate(dir_ / "a/w").WriteRecord(MakeRecord(dir_ / "a/photos"));
  fs::rename(dir_ / "a", dir_ / "b");
  EXPECT_EQ(Workspace::Open(dir_ / "b/w").ReadRecord()->images, dir_ / "b/photos");
}

TEST_F(WorkspaceTest, OtherFoldersAreRefused) {
  std::ofstream(dir_ / "letter.txt") << "hello";
  EXPECT_THROW(Workspace::OpenOrCreate(dir_), Error);
  EXPECT_THROW(Workspace::OpenOrCreate(dir_ / "letter.txt"), Error);
  EXPECT_THROW(Workspace::Open(dir_), Error);
  EXPECT_THROW(Workspace::Open(dir_ / "absent"), Error);
}

TEST_F(WorkspaceTest, AnotherVersionIsNamed) {
  Workspace::OpenOrCreate(dir_ / "w").WriteRecord(MakeRecord(dir_));
  std::ofstream(dir_ / "w/run.json") << R"({"format": "rilievo-workspace", "version": 99})";
  try {
    Workspace::OpenOrCreate(dir_ / "w");
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kVersion);
    EXPECT_NE(std::string(error.what()).find("99"), std::string::npos);
  }
}

TEST_F(WorkspaceTest, ADamagedRecordIsNamedByReadersAndReplacedByARun) {
  Workspace::OpenOrCreate(dir_ / "w").WriteRecord(MakeRecord(dir_));
  for (const char* damage : {"{", "[]", R"({"format": "rilievo-workspace", "version": 1})"}) {
    std::ofstream(dir_ / "w/run.json") << damage;
    EXPECT_THROW(Workspace::Open(dir_ / "w").ReadRecord(), Error) << damage;
    Workspace::OpenOrCreate(dir_ / "w").WriteRecord(MakeRecord(dir_));
    EXPECT_TRUE(Workspace::Open(dir_ / "w").ReadRecord());
  }
}

}  // namespace
}  // namespace rilievo::scheduling
