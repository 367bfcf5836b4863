// Derives the keys: SHA-256 over stage name, versions, options and the keys of the inputs.
#include "scheduling/orient_keys.h"

#include "base/hash.h"
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

engine::ArtifactKey TileKey(const PairTile& tile, const Block& block, const OrientOptions& options,
                            const std::vector<engine::ArtifactKey>& features, std::string_view processor_level) {
  KeyHasher hasher;
  hasher.Add("pairs").Add(processor_level).Add(std::uint64_t{matching::kVersion}).Add(std::uint64_t{verification::kVersion});
  hasher.Add(OptionKeyText(options.matching, matching::OptionDeclarations()));
  hasher.Add(OptionKeyText(options.verification, verification::OptionDeclarations()));
  hasher.Add(std::uint64_t{tile.pairs.size()});
  for (const ImagePair& pair : tile.pairs) {
    for (const ImageId id : {pair.first, pair.second}) {
      hasher.Add(features[id.value].digest);
      AddCamera(hasher, block.camera_of(id));
    }
  }
  return {"pairs", hasher.Finish()};
}

}  // namespace

OrientKeys ComputeKeys(const Block& block, const OrientOptions& options, std::string_view processor_level) {
  OrientKeys keys;
  for (const Image& image : block.images) keys.features.push_back(FeatureKey(image, options));
  keys.tiles = TilePairs(SelectPairs(block.images.size(), options.network, options.tracks.closed_sequence),
                         TileEdge(block.images.size()));
  for (const PairTile& tile : keys.tiles)
    keys.pairs.push_back(TileKey(tile, block, options, keys.features, processor_level));

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
  for (const auto& key : keys.pairs) hasher.Add(key.digest);
  keys.orientation = {"orientation", hasher.Finish()};
  return keys;
}

}  // namespace rilievo::scheduling
