// Keys follow content, cameras and options, and nothing else.
#include "scheduling/orient_keys.h"

#include <gtest/gtest.h>

namespace rilievo::scheduling {
namespace {

Block MakeBlock(std::size_t images) {
  Block block;
  block.cameras.push_back({.id = CameraId(0),
                           .model = {.fx = 1000, .fy = 1001, .cx = 500, .cy = 400},
                           .width_px = 1000,
                           .height_px = 800,
                           .label = ""});
  for (std::uint32_t i = 0; i < images; ++i) {
    Image image;
    image.id = ImageId(i);
    image.camera_id = CameraId(0);
    image.name = std::to_string(i) + ".jpg";
    image.width_px = 1000;
    image.height_px = 800;
    image.content.bytes[0] = static_cast<std::uint8_t>(i + 1);
    block.images.push_back(image);
  }
  return block;
}

TEST(ComputeKeys, NamesDoNotCount) {
  Block block = MakeBlock(7);
  const OrientKeys before = ComputeKeys(block, {}, "base");
  for (Image& image : block.images) image.name = "other/" + image.name;
  block.cameras[0].label = "another file";
  const OrientKeys after = ComputeKeys(block, {}, "base");
  EXPECT_EQ(before.orientation, after.orientation);
  EXPECT_EQ(before.features, after.features);
  EXPECT_EQ(before.pairs, after.pairs);
}

TEST(ComputeKeys, ChangedContentInvalidatesJustItsOwn) {
  Block block = MakeBlock(7);
  const OrientKeys before = ComputeKeys(block, {}, "base");
  block.images[3].content.bytes[31] ^= 1;
  const OrientKeys after = ComputeKeys(block, {}, "base");
  for (std::size_t i = 0; i < 7; ++i) EXPECT_EQ(before.features[i] == after.features[i], i != 3);
  for (std::size_t t = 0; t < before.tiles.size(); ++t) {
    bool holds_it = false;
    for (const ImagePair& pair : before.tiles[t].pairs)
      holds_it |= pair.first == ImageId(3) || pair.second == ImageId(3);
    EXPECT_EQ(before.pairs[t] == after.pairs[t], !holds_it);
  }
  EXPECT_NE(before.orientation, after.orientation);
}

TEST(ComputeKeys, AMaskCountsByItsContentForItsImage) {
  Block block = MakeBlock(5);
  const OrientKeys without = ComputeKeys(block, {}, "base");
  block.images[2].mask = MaskFile{"2.png", {}, 1000};
  const OrientKeys with = ComputeKeys(block, {}, "base");
  for (std::size_t i = 0; i < 5; ++i) EXPECT_EQ(without.features[i] == with.features[i], i != 2);
  EXPECT_NE(without.orientation, with.orientation);
  block.images[2].mask->name = "other/2.tif";
  block.images[2].mask->load_peak_bytes = 7;
  EXPECT_EQ(ComputeKeys(block, {}, "base").features, with.features);
  block.images[2].mask->content.bytes[9] = 1;
  EXPECT_NE(ComputeKeys(block, {}, "base").features[2], with.features[2]);
  EXPECT_NE(ComputeKeys(block, {}, "base").features[2], without.features[2]);
}

TEST(ComputeKeys, OptionsOfTiePointsLeaveMatchesAlone) {
  const Block block = MakeBlock(7);
  OrientOptions options;
  options.network = Network::kSequence;
  const OrientKeys before = ComputeKeys(block, options, "base");
  options.tracks.reduce = !options.tracks.reduce;
  const OrientKeys reduced = ComputeKeys(block, options, "base");
  EXPECT_EQ(before.pairs, reduced.pairs);
  EXPECT_NE(before.orientation, reduced.orientation);
  options.tracks.closed_sequence = true;
  std::size_t pairs = 0;
  for (const PairTile& tile : ComputeKeys(block, options, "base").tiles) pairs += tile.pairs.size();
  EXPECT_EQ(pairs, 14U);
}

TEST(ComputeKeys, ThreeImagesHaveTheirTiePointsByTheNetwork) {
  const Block block = MakeBlock(3);
  OrientOptions sequence;
  sequence.network = Network::kSequence;
  const OrientKeys a = ComputeKeys(block, {}, "base"), b = ComputeKeys(block, sequence, "base");
  EXPECT_EQ(a.pairs, b.pairs);
  EXPECT_NE(a.orientation, b.orientation);
}

TEST(ComputeKeys, AnImageAddedAtTheEndKeepsWhatIsDone) {
  const OrientKeys before = ComputeKeys(MakeBlock(6), {}, "base"), after = ComputeKeys(MakeBlock(8), {}, "base");
  for (const auto& key : before.features)
    EXPECT_NE(std::find(after.features.begin(), after.features.end(), key), after.features.end());
  for (const auto& key : before.pairs)
    EXPECT_NE(std::find(after.pairs.begin(), after.pairs.end(), key), after.pairs.end());
}

TEST(ComputeKeys, CamerasCountForPairsAndNotForFeatures) {
  Block block = MakeBlock(4);
  const OrientKeys before = ComputeKeys(block, {}, "base");
  block.cameras[0].model.fy += 1e-9;
  const OrientKeys after = ComputeKeys(block, {}, "base");
  EXPECT_EQ(before.features, after.features);
  for (std::size_t t = 0; t < before.pairs.size(); ++t) EXPECT_NE(before.pairs[t], after.pairs[t]);
}

TEST(ComputeKeys, AnOptionInvalidatesItsStageAndWhatFollows) {
  const Block block = MakeBlock(4);
  const OrientKeys base = ComputeKeys(block, {}, "base");
  OrientOptions options;
  options.mapping.min_resection_inliers += 1;
  EXPECT_EQ(ComputeKeys(block, options, "base").pairs, base.pairs);
  EXPECT_NE(ComputeKeys(block, options, "base").orientation, base.orientation);
  options = {};
  options.matching.ratio = 0.7;
  EXPECT_EQ(ComputeKeys(block, options, "base").features, base.features);
  EXPECT_NE(ComputeKeys(block, options, "base").pairs, base.pairs);
}

TEST(ComputeKeys, AListedPairCountsForTheOrientation) {
  const Block block = MakeBlock(5);
  OrientOptions options;
  options.network = Network::kList;
  options.listed = {{ImageId(0), ImageId(1)}, {ImageId(1), ImageId(4)}};
  const OrientKeys before = ComputeKeys(block, options, "base");
  std::size_t pairs = 0;
  for (const PairTile& tile : before.tiles) pairs += tile.pairs.size();
  EXPECT_EQ(pairs, 2U);
  options.listed.pop_back();
  EXPECT_NE(ComputeKeys(block, options, "base").orientation, before.orientation);
}

TEST(ComputeKeys, AGuidedOrientationIsKnownBeforeItsTiles) {
  Block block = MakeBlock(6);
  OrientOptions options;
  options.network = Network::kGuided;
  const OrientKeys base = ComputeKeys(block, options, "base");
  EXPECT_TRUE(base.tiles.empty());
  EXPECT_FALSE(base.tiles_complete);
  const auto orientation = [&] { return ComputeKeys(block, options, "base").orientation; };
  EXPECT_EQ(orientation(), base.orientation);
  EXPECT_NE(ComputeKeys(block, {}, "base").orientation, base.orientation);
  options.pairs.neighbours += 1;
  EXPECT_EQ(orientation(), base.orientation) << "an option of spatial blocks";
  options.pairs.guided_features += 1;
  EXPECT_NE(orientation(), base.orientation);
  options.pairs = {};
  options.matching.ratio = 0.7;
  EXPECT_NE(orientation(), base.orientation);
  options.matching = {};
  block.images[2].content.bytes[0] ^= 1;
  EXPECT_NE(orientation(), base.orientation);
}

}  // namespace
}  // namespace rilievo::scheduling
