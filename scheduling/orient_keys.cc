// Derives the keys: SHA-256 over stage name, versions, options and the keys of the inputs.
#include "scheduling/orient_keys.h"

#include "base/hash.h"
#include "scheduling/guided_pairs.h"
#include "stages/adjustment/adjustment.h"
#include "stages/tracks/tracks.h"

namespace rilievo::scheduling {
namespace {

/// Bumped when the payload of the orientation artifact changes its layout.
constexpr std::uint64_t kOrientationFormat = 4;

void AddCamera(KeyHasher& hasher, const Camera& camera) {
  const CameraModel& m = camera.model;
  hasher.Add(CameraModelName(m.kind));
  for (const double value : {m.fx, m.fy, m.cx, m.cy, m.k1, m.k2, m.p1, m.p2, m.k3, m.k4, m.k5, m.k6}) hasher.Add(value);
  hasher.Add(std::uint64_t(camera.width_px)).Add(std::uint64_t(camera.height_px)).Add(std::uint64_t(camera.source));
}

engine::ArtifactKey FeatureKey(const Image& image, const OrientOptions& options) {
  KeyHasher hasher;
  hasher.Add("features").Add(std::uint64_t{features::kVersion});
  hasher.Add(OptionKeyText(options.features, features::OptionDeclarations())).Add(image.content);
  if (image.mask) hasher.Add("mask").Add(image.mask->content);
  return {"features", hasher.Finish()};
}

/// The pairs that an orientation is made of: its tiles, or for a guided block what decides about them.
void AddPairs(KeyHasher& hasher, const OrientOptions& options, const OrientKeys& keys) {
  if (options.network != Network::kGuided) {
    for (const auto& key : keys.pairs) hasher.Add(key.digest);
    return;
  }
  hasher.Add("guided").Add(std::uint64_t{kGuidedVersion}).Add(std::uint64_t(options.pairs.guided_features));
  AddMatchingTo(hasher, options, keys);
}

}  // namespace

void AddMatchingTo(KeyHasher& hasher, const OrientOptions& options, const OrientKeys& keys) {
  hasher.Add(keys.processor_level)
      .Add(std::uint64_t{matching::kVersion})
      .Add(std::uint64_t{verification::kVersion})
      .Add(OptionKeyText(options.matching, matching::OptionDeclarations()))
      .Add(OptionKeyText(options.verification, verification::OptionDeclarations()));
}

engine::ArtifactKey TileKey(const PairTile& tile, const Block& block, const OrientOptions& options,
                            const OrientKeys& keys) {
  KeyHasher hasher;
  hasher.Add("pairs");
  AddMatchingTo(hasher, options, keys);
  hasher.Add(std::uint64_t{tile.pairs.size()});
  for (const ImagePair& pair : tile.pairs) {
    for (const ImageId id : {pair.first, pair.second}) {
      hasher.Add(keys.features[id.value].digest);
      AddCamera(hasher, block.camera_of(id));
    }
  }
  return {"pairs", hasher.Finish()};
}

void AddTileKeys(std::vector<PairTile> tiles, const Block& block, const OrientOptions& options, OrientKeys& keys) {
  for (PairTile& tile : tiles) {
    keys.pairs.push_back(TileKey(tile, block, options, keys));
    keys.tiles.push_back(std::move(tile));
  }
}

OrientKeys ComputeKeys(const Block& block, const OrientOptions& options, std::string_view processor_level) {
  OrientKeys keys;
  keys.processor_level = processor_level;
  for (const Image& image : block.images) keys.features.push_back(FeatureKey(image, options));
  const std::size_t images = block.images.size();
  const std::vector<ImagePair> pairs =
      options.listed.empty() ? SelectPairs(images, options.network, options.tracks.closed_sequence) : options.listed;
  AddTileKeys(TilePairs(pairs, TileEdge(images)), block, options, keys);
  keys.tiles_complete = options.network != Network::kGuided;

  KeyHasher hasher;
  hasher.Add("orientation")
      .Add(kOrientationFormat)
      .Add(std::uint64_t{tracks::kVersion})
      .Add(std::uint64_t{mapping::kVersion});
  // Three images have the same pairs in both networks, but tie points of different rules.
  hasher.Add(options.network == Network::kSequence ? "triplets" : "pairs")
      .Add(OptionKeyText(options.tracks, tracks::OptionDeclarations()));
  hasher.Add(std::uint64_t{adjustment::kVersion})
      .Add(processor_level)
      .Add(OptionKeyText(options.mapping, mapping::OptionDeclarations()));
  for (const Image& image : block.images) {
    hasher.Add(keys.features[image.id.value].digest);
    AddCamera(hasher, block.camera_of(image.id));
  }
  AddPairs(hasher, options, keys);
  keys.orientation = {"orientation", hasher.Finish()};
  return keys;
}

}  // namespace rilievo::scheduling
