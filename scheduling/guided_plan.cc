// Tasks, keys and payloads of sketches, the visibility map and the rounds of growth.
#include "scheduling/guided_plan.h"

#include <algorithm>
#include <span>
#include <string>
#include <utility>

#include "base/serialize.h"
#include "base/units.h"
#include "block/io/serialize_block.h"
#include "scheduling/counted_io.h"
#include "scheduling/feature_tasks.h"
#include "scheduling/guided_pairs.h"
#include "scheduling/orient_costs.h"
#include "scheduling/pair_tasks.h"

namespace rilievo::scheduling {
namespace {

using engine::ArtifactKey;
using engine::TaskContext;

// ---- keys and payloads ----------------------------------------------------------------------------------------------

ArtifactKey SketchKey(const OrientOptions& options, const ArtifactKey& features) {
  KeyHasher hasher;
  hasher.Add("sketches").Add(std::uint64_t{kGuidedVersion}).Add(std::uint64_t(options.pairs.guided_features));
  hasher.Add(features.digest);
  return {"sketches", hasher.Finish()};
}

ArtifactKey VisibilityKey(const PairTile& tile, const OrientOptions& options, const OrientKeys& keys) {
  KeyHasher hasher;
  hasher.Add("visibility").Add(std::uint64_t{kGuidedVersion}).Add(std::uint64_t{matching::kVersion});
  hasher.Add(OptionKeyText(options.matching, matching::OptionDeclarations()));
  hasher.Add(std::uint64_t{tile.pairs.size()});
  for (const ImagePair& pair : tile.pairs)
    for (const ImageId id : {pair.first, pair.second}) hasher.Add(SketchKey(options, keys.features[id.value]).digest);
  return {"visibility", hasher.Finish()};
}

/// Of the round that looks at these tiles: their digests in ascending order, because they come in any.
ArtifactKey GrowthKey(std::vector<ArtifactKey> tiles, const OrientKeys& keys) {
  KeyHasher hasher;
  hasher.Add("growth").Add(std::uint64_t{kGuidedVersion}).Add(std::uint64_t{keys.features.size()});
  for (const auto& key : keys.features) hasher.Add(key.digest);
  std::sort(tiles.begin(), tiles.end());
  for (const auto& key : tiles) hasher.Add(key.digest);
  return {"growth", hasher.Finish()};
}

/// Like pairs, sightings are numbered within their tile: the artifact does not know the block's numbering.
std::vector<std::byte> Serialize(std::span<const Sighting> sightings) {
  ByteWriter writer;
  writer.Put<std::uint64_t>(sightings.size());
  for (const Sighting& sighting : sightings) {
    writer.Put(sighting.matches);
    writer.Put<std::uint8_t>(sighting.is_strong ? 1 : 0);
  }
  return writer.Take();
}

std::vector<Sighting> LoadSightings(const PairTile& tile, std::span<const std::byte> payload) {
  ByteReader reader(payload);
  if (reader.Get<std::uint64_t>() != tile.pairs.size())
    throw Error(ErrorCode::kInvalidInput, "", "a visibility artifact does not fit its tile");
  std::vector<Sighting> sightings;
  for (const ImagePair& pair : tile.pairs) {
    const auto matches = reader.Get<std::uint32_t>();
    sightings.push_back({pair, matches, reader.Get<std::uint8_t>() != 0});
  }
  return sightings;
}

std::vector<std::byte> Serialize(const std::vector<ImagePair>& pairs) {
  ByteWriter writer;
  writer.PutVector(pairs);
  return writer.Take();
}

std::vector<ImagePair> LoadPairs(std::span<const std::byte> payload) {
  return ByteReader(payload).GetVector<ImagePair>();
}

// ---- tasks ----------------------------------------------------------------------------------------------------------

struct GuidedState {
  std::vector<PairTile> map_tiles;
  std::vector<std::vector<Sighting>> sightings;  ///< slot a map tile
  std::vector<ImagePair> grown;                  ///< of the last round
  std::size_t rounds = 0;
  std::function<void(TaskId, engine::Plan&)> finish;
};

void RunSketchTask(const OrientRun& run, ImageId id, TaskContext& context) {
  const ArtifactKey key = SketchKey(run.options, run.keys.features[id.value]);
  if (run.store.Verify(key)) return context.MarkReused();
  const ImageFeatures features = LoadFeatures(run, id, context);
  const auto count = static_cast<std::size_t>(run.options.pairs.guided_features);
  PublishCounted(run.store, key, io::Serialize(Sketch(features, count)), context);
}

std::vector<Sighting> LookAtTile(const OrientRun& run, const PairTile& tile, TaskContext& context) {
  std::vector<ImageFeatures> sketches(tile.images.size());
  for (std::size_t i = 0; i < sketches.size(); ++i)
    sketches[i] = io::DeserializeFeatures(
        ReadPublished(run.store, SketchKey(run.options, run.keys.features[tile.images[i].value]), "sketches", context));
  const auto sketch_of = [&](ImageId id) -> const ImageFeatures& {
    const auto found = std::lower_bound(tile.images.begin(), tile.images.end(), id);
    return sketches[static_cast<std::size_t>(found - tile.images.begin())];
  };
  const bool by_sign = features::ComparesEqualSignsOnly(run.options.features);
  std::vector<Sighting> sightings;
  for (const ImagePair& pair : tile.pairs) {
    context.ThrowIfStopped();
    const ImageFeatures &a = sketch_of(pair.first), &b = sketch_of(pair.second);
    const auto matches = by_sign ? matching::RunBySign(a, b, run.options.matching, context)
                                 : matching::Run(a.descriptors, b.descriptors, run.options.matching, context);
    sightings.push_back({pair, static_cast<std::uint32_t>(matches.size()),
                         matches.size() >= StrongMatches(a.descriptors.size(), b.descriptors.size())});
  }
  return sightings;
}

void RunVisibilityTask(const OrientRun& run, const PairTile& tile, std::vector<Sighting>& slot, TaskContext& context) {
  const ArtifactKey key = VisibilityKey(tile, run.options, run.keys);
  if (const auto payload = ReadCounted(run.store, key, context)) {
    slot = LoadSightings(tile, *payload);
    context.MarkReused();
    return;
  }
  slot = LookAtTile(run, tile, context);
  PublishCounted(run.store, key, Serialize(slot), context);
}

std::vector<ArtifactKey> KeysOf(const OrientRun& run) {
  std::vector<ArtifactKey> keys;
  for (const auto& tile : run.tiles) keys.push_back(tile->key);
  return keys;
}

void RunGrowthTask(const OrientRun& run, GuidedState& state, TaskContext& context) {
  const ArtifactKey key = GrowthKey(KeysOf(run), run.keys);
  if (const auto payload = ReadCounted(run.store, key, context)) {
    state.grown = LoadPairs(*payload);
    context.MarkReused();
    return;
  }
  CommonFeatures common(run.block.images.size());
  for (const auto& tile : run.tiles) {
    context.ThrowIfStopped();
    for (const auto& pair : LoadTile(tile->tile, ReadPublished(run.store, tile->key, "matches", context)))
      common.Add(pair);
  }
  state.grown = common.Candidates(kLeastCommon, context);
  PublishCounted(run.store, key, Serialize(state.grown), context);
}

TaskCost GrowthTaskCost(const OrientRun& run) {
  std::uint64_t inliers = 0, largest_tile = 0;
  for (const auto& tile : run.tiles) {
    std::uint64_t in_tile = 0;
    for (const PairSummary& pair : tile->pairs) in_tile += pair.inliers;
    inliers += in_tile;
    largest_tile = std::max<std::uint64_t>(
        largest_tile, 2 * (in_tile * sizeof(Match) + tile->pairs.size() * sizeof(TwoViewGeometry)));
  }
  return {CommonFeatures::Bytes(run.block.images.size(), inliers) + largest_tile + kMebibyte,
          0.05 + 1e-7 * static_cast<double>(inliers)};
}

void AddGrowth(const std::shared_ptr<OrientRun>& run, const std::shared_ptr<GuidedState>& state, engine::Plan& plan);

/// The round itself, when the counts that its memory depends on are known.
void AddRound(const std::shared_ptr<OrientRun>& run, const std::shared_ptr<GuidedState>& state, TaskId gathered,
              engine::Plan& plan) {
  const TaskId id(static_cast<std::uint32_t>(plan.size()));
  const TaskCost cost = GrowthTaskCost(*run);
  plan.Add({.name = "growth " + std::to_string(state->rounds),
            .stage = "growth",
            .needs = {gathered},
            .cost = cost,
            .memory_hint = MemoryHint(*run, cost.peak_bytes, "lower --max-features"),
            .run = [run, state, id](TaskContext& context) {
              RunGrowthTask(*run, *state, context);
              context.Grow([run, state, id](engine::Plan& grown) {
                if (state->grown.empty()) return state->finish(id, grown);
                AddTiles(run, state->grown, grown);
                AddGrowth(run, state, grown);
              });
            }});
}

/// A round of growth after all pairs so far.
void AddGrowth(const std::shared_ptr<OrientRun>& run, const std::shared_ptr<GuidedState>& state, engine::Plan& plan) {
  const TaskId id(static_cast<std::uint32_t>(plan.size()));
  plan.Add({.name = "gather " + std::to_string(++state->rounds),
            .stage = "gather",
            .needs = run->tile_tasks,
            .cost = {},
            .memory_hint = "",
            .run = [run, state, id](TaskContext& context) {
              context.Grow([run, state, id](engine::Plan& grown) { AddRound(run, state, id, grown); });
            }});
}

/// The map is whole: the best partners of images, and then the first round.
void CompleteMap(const std::shared_ptr<OrientRun>& run, const std::shared_ptr<GuidedState>& state, engine::Plan& plan) {
  std::vector<Sighting> all;
  for (const auto& tile : state->sightings) all.insert(all.end(), tile.begin(), tile.end());
  AddTiles(run, BestPartners(all, run->block.images.size(), kBestPartners), plan);
  AddGrowth(run, state, plan);
}

TaskId AddSketchTask(const std::shared_ptr<OrientRun>& run, const Image& image, engine::Plan& plan) {
  const TaskCost cost = SketchTaskCost(*run);
  return plan.Add({.name = "sketch " + image.name,
                   .stage = "sketches",
                   .needs = {run->feature_tasks[image.id.value]},
                   .cost = cost,
                   .units = {1, "images"},
                   .memory_hint = MemoryHint(*run, cost.peak_bytes, "lower --max-features"),
                   .run = [run, id = image.id](TaskContext& context) { RunSketchTask(*run, id, context); }});
}

TaskId AddVisibilityTask(const std::shared_ptr<OrientRun>& run, const std::shared_ptr<GuidedState>& state,
                         std::size_t t, std::span<const TaskId> sketches, engine::Plan& plan) {
  const PairTile& tile = state->map_tiles[t];
  std::vector<TaskId> needs;
  for (const ImageId id : tile.images) needs.push_back(sketches[id.value]);
  const TaskCost cost = VisibilityTaskCost(*run, tile);
  return plan.Add(
      {.name = "visibility " + std::to_string(t),
       .stage = "visibility",
       .needs = std::move(needs),
       .cost = cost,
       .units = {static_cast<double>(tile.pairs.size()), "pairs"},
       .memory_hint = MemoryHint(*run, cost.peak_bytes, "lower --guided-features"),
       .run = [run, state, t](TaskContext& context) {
         RunVisibilityTask(*run, state->map_tiles[t], state->sightings[t], context);
         context.Grow([run, state, t](engine::Plan& grown) { AddTiles(run, StrongPairs(state->sightings[t]), grown); });
       }});
}

}  // namespace

std::vector<PairTile> VisibilityTiles(std::size_t images) {
  return TilePairs(SelectPairs(images, Network::kSparse), kVisibilityEdge);
}

TaskCost SketchTaskCost(const OrientRun& run) {
  // The artifact, the features inside it and their parsed form; the sketch and its payload are smaller.
  const auto cap = static_cast<std::uint64_t>(run.options.features.max_features);
  const auto sketch = std::min(cap, static_cast<std::uint64_t>(run.options.pairs.guided_features));
  return {(3 * cap + 2 * sketch) * kFeatureBytes + kMebibyte, 0.002};
}

TaskCost VisibilityTaskCost(const OrientRun& run, const PairTile& tile) {
  const auto sketch = static_cast<std::size_t>(run.options.pairs.guided_features);
  const TaskCost match = matching::Estimate(sketch, sketch, run.options.matching);
  return {kFeatureBytes * sketch * (tile.images.size() + 3) + match.peak_bytes + tile.pairs.size() * 100,
          match.work * static_cast<double>(tile.pairs.size())};
}

void AddGuidedTasks(const std::shared_ptr<OrientRun>& run, engine::Plan& plan,
                    std::function<void(TaskId, engine::Plan&)> finish) {
  const auto state = std::make_shared<GuidedState>();
  state->map_tiles = VisibilityTiles(run->block.images.size());
  state->sightings.resize(state->map_tiles.size());
  state->finish = std::move(finish);
  std::vector<TaskId> sketches, all;
  std::size_t next = 0;  // tile of the map
  for (const Image& image : run->block.images) {
    run->feature_tasks.push_back(AddFeatureTask(run, image, plan));
    sketches.push_back(AddSketchTask(run, image, plan));
    all.insert(all.end(), {run->feature_tasks.back(), sketches.back()});
    for (; next < state->map_tiles.size() && state->map_tiles[next].images.back() == image.id; ++next)
      all.push_back(AddVisibilityTask(run, state, next, sketches, plan));
  }
  plan.Add({.name = "visibility map",
            .stage = "gather",
            .needs = std::move(all),
            .cost = {},
            .memory_hint = "",
            .run = [run, state](TaskContext& context) {
              context.Grow([run, state](engine::Plan& grown) { CompleteMap(run, state, grown); });
            }});
}

namespace {

/// Adds to `keys` the tiles that the results tell of; calls on_growth(key) for each round whose result there is.
template <class OnGrowth>
void WalkGuided(const Block& block, const OrientOptions& options, const engine::ArtifactStore& store, OrientKeys& keys,
                OnGrowth&& on_growth) {
  const std::size_t images = block.images.size(), edge = TileEdge(images);
  const auto add = [&](const std::vector<ImagePair>& pairs) {
    AddTileKeys(TilePairs(pairs, edge), block, options, keys);
  };
  std::vector<Sighting> all;
  bool map_complete = true;
  for (const PairTile& tile : VisibilityTiles(images)) {
    const auto payload = store.Read(VisibilityKey(tile, options, keys));
    map_complete &= payload.has_value();
    if (!payload) continue;
    const std::vector<Sighting> sightings = LoadSightings(tile, *payload);
    add(StrongPairs(sightings));
    all.insert(all.end(), sightings.begin(), sightings.end());
  }
  if (!map_complete) return;
  add(BestPartners(all, images, kBestPartners));
  for (ArtifactKey key = GrowthKey(keys.pairs, keys);; key = GrowthKey(keys.pairs, keys)) {
    const auto payload = store.Read(key);
    if (!payload) return;
    on_growth(key);
    const std::vector<ImagePair> grown = LoadPairs(*payload);
    keys.tiles_complete = grown.empty();
    if (grown.empty()) return;
    add(grown);
  }
}

}  // namespace

void FindGuidedTiles(const Block& block, const OrientOptions& options, const engine::ArtifactStore& store,
                     OrientKeys& keys) {
  WalkGuided(block, options, store, keys, [](const ArtifactKey&) {});
}

std::vector<ArtifactKey> GuidedKeys(const Block& block, const OrientOptions& options,
                                    const engine::ArtifactStore& store, const OrientKeys& keys) {
  std::vector<ArtifactKey> found;
  for (const auto& features : keys.features) found.push_back(SketchKey(options, features));
  for (const PairTile& tile : VisibilityTiles(block.images.size())) found.push_back(VisibilityKey(tile, options, keys));
  OrientKeys walked = keys;
  walked.tiles.clear();
  walked.pairs.clear();
  WalkGuided(block, options, store, walked, [&](const ArtifactKey& key) { found.push_back(key); });
  return found;
}

}  // namespace rilievo::scheduling
