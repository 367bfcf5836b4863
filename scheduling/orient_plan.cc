// The tasks of an orientation run and the artifacts they publish.
#include "scheduling/orient_plan.h"

#include <algorithm>
#include <span>
#include <utility>

#include "base/cpu.h"
#include "base/hash.h"
#include "base/rng.h"
#include "base/serialize.h"
#include "block/coverage.h"
#include "block/io/serialize_block.h"
#include "scheduling/orient_costs.h"
#include "stages/images/masks.h"
#include "stages/tracks/tie_points.h"

namespace rilievo::scheduling {
namespace {

using engine::ArtifactKey;
using engine::TaskContext;

/// Reads an artifact and counts its bytes for the trace.
std::optional<std::vector<std::byte>> ReadCounted(const OrientRun& run, const ArtifactKey& key, TaskContext& context) {
  auto payload = run.store.Read(key);
  if (payload) context.CountBytes(payload->size(), 0);
  return payload;
}

void PublishCounted(const OrientRun& run, const ArtifactKey& key, std::span<const std::byte> payload,
                    TaskContext& context) {
  run.store.Publish(key, payload);
  context.CountBytes(0, payload.size());
}

// ---- features -------------------------------------------------------------------------------------------------------

struct FeatureArtifact {
  std::string quarantine;
  ImageFeatures features;
};

std::vector<std::byte> Serialize(const FeatureArtifact& artifact) {
  ByteWriter writer;
  writer.PutString(artifact.quarantine);
  writer.PutVector(io::Serialize(artifact.features));
  return writer.Take();
}

FeatureArtifact DeserializeFeatureArtifact(std::span<const std::byte> payload) {
  ByteReader reader(payload);
  FeatureArtifact artifact;
  artifact.quarantine = reader.GetString();
  artifact.features = io::DeserializeFeatures(reader.GetVector<std::byte>());
  return artifact;
}

FeatureArtifact ComputeFeatures(const OrientRun& run, const Image& image, TaskContext& context) {
  FeatureArtifact artifact;
  try {
    std::vector<std::uint8_t> mask;
    if (image.mask) mask = images::LoadMask(*run.masks, *image.mask, image);
    const GreyImage pixels = run.pixels.Load(image.name, true);
    if (pixels.width_px != image.width_px || pixels.height_px != image.height_px)
      throw Error(ErrorCode::kInvalidInput, image.name, "its header and its pixels disagree about the image size");
    context.ThrowIfStopped();
    artifact.features = features::Run({pixels, mask, FeatureTiling(run, image)}, run.options.features, context);
  } catch (const Error& error) {
    // A property of the bytes of the image or its mask, which the key covers: the image is quarantined and the survey
    // goes on.
    if (error.code() != ErrorCode::kInvalidInput && error.code() != ErrorCode::kUnsupported) throw;
    artifact.quarantine = error.message();
  }
  return artifact;
}

ImageSummary Summarise(const Image& image, const FeatureArtifact& artifact) {
  const auto& keypoints = artifact.features.keypoints;
  return {static_cast<std::uint32_t>(keypoints.size()), artifact.quarantine,
          Coverage(keypoints, image.width_px, image.height_px)};
}

void RunFeatureTask(OrientRun& run, ImageId id, TaskContext& context) {
  const Image& image = run.block.image(id);
  const ArtifactKey& key = run.keys.features[id.value];
  ImageSummary& summary = run.images[id.value];
  if (const auto payload = ReadCounted(run, key, context)) {
    summary = Summarise(image, DeserializeFeatureArtifact(*payload));
    context.MarkReused();
    return;
  }
  const FeatureArtifact artifact = ComputeFeatures(run, image, context);
  summary = Summarise(image, artifact);
  PublishCounted(run, key, Serialize(artifact), context);
}

/// The features of one image, which its feature task has published.
ImageFeatures LoadFeatures(const OrientRun& run, ImageId id, TaskContext& context) {
  const ArtifactKey& key = run.keys.features[id.value];
  auto payload = ReadCounted(run, key, context);
  if (!payload)
    throw Error(ErrorCode::kUnreadable, run.store.PathOf(key).string(),
                "features were damaged or removed during the run", "run the same command again");
  return DeserializeFeatureArtifact(*payload).features;
}

// ---- pairs ----------------------------------------------------------------------------------------------------------

/// Seeds a pair by the features of its images, so that its result depends neither on the other images nor on bytes of
/// the files that are no pixels.
class PairContext : public RunContext {
 public:
  PairContext(RunContext& base, const ImageFeatures& first, const ImageFeatures& second) : base_(base) {
    const std::uint64_t a = Checksum(std::as_bytes(std::span(first.keypoints)));
    const std::uint64_t b = Checksum(std::as_bytes(std::span(second.keypoints)));
    seed_ = Mix64(base.Seed() ^ Mix64(a) ^ Mix64(Mix64(b)));
  }
  bool StopRequested() const override { return base_.StopRequested(); }
  std::uint64_t Seed() const override { return seed_; }
  void ParallelFor(std::size_t n, std::size_t grain, const std::function<void(std::size_t, std::size_t)>& fn) override {
    base_.ParallelFor(n, grain, fn);
  }
  void ReportProgress(double) override {}

 private:
  RunContext& base_;
  std::uint64_t seed_ = 0;
};

PairSummary Summarise(const TwoViewGeometry& g) {
  return {g.pair,
          g.model,
          g.reason,
          g.matches,
          static_cast<std::uint32_t>(g.inliers.size()),
          g.median_angle_rad,
          g.homography_ratio};
}

/// Pairs inside an artifact are numbered within their tile: the artifact does not know the block's numbering.
std::vector<TwoViewGeometry> LoadTile(const PairTile& tile, std::span<const std::byte> payload) {
  std::vector<TwoViewGeometry> pairs = io::DeserializePairs(payload);
  if (pairs.size() != tile.pairs.size())
    throw Error(ErrorCode::kInvalidInput, "", "a pair artifact does not fit its tile");
  for (std::size_t i = 0; i < pairs.size(); ++i) pairs[i].pair = tile.pairs[i];
  return pairs;
}

TwoViewGeometry MatchAndVerify(const OrientRun& run, const ImagePair& pair, const ImageFeatures& first,
                               const ImageFeatures& second, TaskContext& context) {
  const auto matches = features::ComparesEqualSignsOnly(run.options.features)
                           ? matching::RunBySign(first, second, run.options.matching, context)
                           : matching::Run(first.descriptors, second.descriptors, run.options.matching, context);
  PairContext pair_context(context, first, second);
  const verification::Input input{{ImageId(0), ImageId(1)},
                                  run.block.camera_of(pair.first),
                                  run.block.camera_of(pair.second),
                                  first.keypoints,
                                  second.keypoints,
                                  matches};
  TwoViewGeometry geometry = verification::Run(input, run.options.verification, pair_context);
  geometry.matches = static_cast<std::uint32_t>(matches.size());
  return geometry;
}

void RunPairTask(OrientRun& run, std::size_t tile_index, TaskContext& context) {
  const PairTile& tile = run.keys.tiles[tile_index];
  const ArtifactKey& key = run.keys.pairs[tile_index];
  std::vector<PairSummary>& summaries = run.pairs[tile_index];
  if (const auto payload = ReadCounted(run, key, context)) {
    for (const auto& geometry : LoadTile(tile, *payload)) summaries.push_back(Summarise(geometry));
    context.MarkReused();
    return;
  }
  std::vector<ImageFeatures> loaded;
  for (const ImageId id : tile.images) loaded.push_back(LoadFeatures(run, id, context));
  const auto features_of = [&](ImageId id) -> const ImageFeatures& {
    return loaded[static_cast<std::size_t>(std::lower_bound(tile.images.begin(), tile.images.end(), id) -
                                           tile.images.begin())];
  };
  std::vector<TwoViewGeometry> pairs;
  for (const ImagePair& pair : tile.pairs) {
    context.ThrowIfStopped();
    pairs.push_back(MatchAndVerify(run, pair, features_of(pair.first), features_of(pair.second), context));
    context.ReportProgress(static_cast<double>(pairs.size()) / static_cast<double>(tile.pairs.size()));
  }
  PublishCounted(run, key, io::Serialize(pairs), context);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    pairs[i].pair = tile.pairs[i];
    summaries.push_back(Summarise(pairs[i]));
  }
}

// ---- orientation ----------------------------------------------------------------------------------------------------

std::vector<std::byte> Serialize(const OrientationResult& result) {
  ByteWriter writer;
  writer.PutVector(io::Serialize(io::MappingResult{result.models, result.unoriented}));
  writer.Put<std::uint64_t>(result.images.size());
  for (const auto& image : result.images) {
    writer.Put(image.features);
    writer.PutString(image.quarantine);
    writer.Put(image.coverage);
  }
  writer.Put<std::uint64_t>(result.pairs.size());
  for (const auto& p : result.pairs) {
    writer.Put(p.pair.first.value);
    writer.Put(p.pair.second.value);
    writer.Put(p.model);
    writer.Put(p.reason);
    writer.Put(p.matches);
    writer.Put(p.inliers);
    writer.Put(p.median_angle_rad);
    writer.Put(p.homography_ratio);
  }
  writer.Put<std::uint64_t>(result.warnings.size());
  for (const auto& warning : result.warnings) writer.PutString(warning);
  writer.Put(result.ties);
  return writer.Take();
}

OrientationResult DeserializeOrientation(std::span<const std::byte> payload) {
  ByteReader reader(payload);
  OrientationResult result;
  io::MappingResult mapped = io::DeserializeMapping(reader.GetVector<std::byte>());
  result.models = std::move(mapped.models);
  result.unoriented = std::move(mapped.unoriented);
  for (auto n = reader.Get<std::uint64_t>(); n > 0; --n) {
    ImageSummary image;
    image.features = reader.Get<std::uint32_t>();
    image.quarantine = reader.GetString();
    image.coverage = reader.Get<double>();
    result.images.push_back(std::move(image));
  }
  for (auto n = reader.Get<std::uint64_t>(); n > 0; --n) {
    PairSummary p;
    p.pair.first = ImageId(reader.Get<std::uint32_t>());
    p.pair.second = ImageId(reader.Get<std::uint32_t>());
    p.model = reader.Get<TwoViewModel>();
    p.reason = reader.Get<RejectionReason>();
    p.matches = reader.Get<std::uint32_t>();
    p.inliers = reader.Get<std::uint32_t>();
    p.median_angle_rad = reader.Get<double>();
    p.homography_ratio = reader.Get<double>();
    result.pairs.push_back(p);
  }
  for (auto n = reader.Get<std::uint64_t>(); n > 0; --n) result.warnings.push_back(reader.GetString());
  result.ties = reader.Get<TieSummary>();
  return result;
}

struct OrientationInputs {
  std::vector<std::vector<Keypoint>> keypoints;
  std::vector<std::vector<Rgb>> colors;
  std::vector<TwoViewGeometry> pairs;
};

OrientationInputs LoadOrientationInputs(const OrientRun& run, TaskContext& context) {
  OrientationInputs inputs;
  for (const Image& image : run.block.images) {
    ImageFeatures features = LoadFeatures(run, image.id, context);
    inputs.keypoints.push_back(std::move(features.keypoints));
    inputs.colors.push_back(std::move(features.colors));
  }
  for (std::size_t t = 0; t < run.keys.tiles.size(); ++t) {
    const auto payload = ReadCounted(run, run.keys.pairs[t], context);
    if (!payload)
      throw Error(ErrorCode::kUnreadable, run.store.PathOf(run.keys.pairs[t]).string(),
                  "matches were damaged or removed during the run", "run the same command again");
    for (auto& geometry : LoadTile(run.keys.tiles[t], *payload)) inputs.pairs.push_back(std::move(geometry));
  }
  std::sort(inputs.pairs.begin(), inputs.pairs.end(), [](const auto& a, const auto& b) { return a.pair < b.pair; });
  return inputs;
}

void RunOrientationTask(OrientRun& run, TaskContext& context) {
  if (const auto payload = ReadCounted(run, run.keys.orientation, context)) {
    context.MarkReused();
    return;
  }
  const OrientationInputs inputs = LoadOrientationInputs(run, context);
  const auto triplets = run.options.network == Network::kSequence
                            ? tracks::SequenceTriplets(run.block.images.size(), run.options.tracks.closed_sequence)
                            : std::vector<tracks::Triplet>{};
  const tracks::TiePoints ties =
      tracks::MakeTiePoints({run.block, inputs.keypoints, inputs.pairs, triplets}, run.options.tracks, context);
  context.ReportProgress(0.05);
  mapping::Output output = mapping::Run({run.block, inputs.keypoints, inputs.colors, inputs.pairs, ties.tracks},
                                        run.options.mapping, context);
  OrientationResult result{
      std::move(output.models), std::move(output.unoriented), run.images, {}, std::move(output.warnings), ties.summary};
  std::erase_if(result.unoriented,
                [&](const UnorientedImage& u) { return !run.images[u.image.value].quarantine.empty(); });
  for (const auto& tile : run.pairs) result.pairs.insert(result.pairs.end(), tile.begin(), tile.end());
  std::sort(result.pairs.begin(), result.pairs.end(), [](const auto& a, const auto& b) { return a.pair < b.pair; });
  PublishCounted(run, run.keys.orientation, Serialize(result), context);
}

void GrowOrientation(const std::shared_ptr<OrientRun>& run, TaskId gathered, engine::Plan& plan) {
  std::uint64_t features = 0, inliers = 0;
  for (const auto& image : run->images) features += image.features;
  for (const auto& tile : run->pairs)
    for (const auto& pair : tile) inliers += pair.inliers;
  const TaskCost cost = OrientationTaskCost(*run, features, inliers);
  plan.Add({.name = "orientation",
            .stage = "orientation",
            .needs = {gathered},
            .cost = cost,
            .memory_hint = MemoryHint(*run, cost.peak_bytes, "lower --max-features"),
            .run = [run](TaskContext& context) { RunOrientationTask(*run, context); }});
}

TaskId AddPairTask(const std::shared_ptr<OrientRun>& run, std::size_t tile_index,
                   const std::vector<TaskId>& feature_tasks, engine::Plan& plan) {
  const PairTile& tile = run->keys.tiles[tile_index];
  std::vector<TaskId> needs;
  for (const ImageId id : tile.images) needs.push_back(feature_tasks[id.value]);
  const TaskCost cost = PairTaskCost(*run, tile);
  return plan.Add({.name = "pairs " + std::to_string(tile_index),
                   .stage = "pairs",
                   .needs = std::move(needs),
                   .cost = cost,
                   .memory_hint = MemoryHint(*run, cost.peak_bytes, "lower --max-features"),
                   .run = [run, tile_index](TaskContext& context) { RunPairTask(*run, tile_index, context); }});
}

}  // namespace

OrientRun::OrientRun(const Block& b, const PixelSource& p, const PixelSource* m, const engine::ArtifactStore& s,
                     OrientOptions o, std::uint64_t overhead)
    : block(b),
      pixels(p),
      masks(m),
      store(s),
      options(std::move(o)),
      keys(ComputeKeys(b, options, ProcessorLevel())),
      images(b.images.size()),
      pairs(keys.tiles.size()),
      overhead_bytes(overhead) {}

OrientRun::OrientRun(const OrientRun& planned, const engine::ArtifactStore& s)
    : block(planned.block),
      pixels(planned.pixels),
      masks(planned.masks),
      store(s),
      options(planned.options),
      keys(planned.keys),
      images(planned.images),
      pairs(planned.pairs),
      overhead_bytes(planned.overhead_bytes),
      budget_bytes(planned.budget_bytes) {}

std::optional<OrientationResult> LoadOrientation(const engine::ArtifactStore& store, const OrientKeys& keys) {
  const auto payload = store.Read(keys.orientation);
  if (!payload) return std::nullopt;
  return DeserializeOrientation(*payload);
}

engine::Plan MakeOrientPlan(std::shared_ptr<OrientRun> run) {
  engine::Plan plan;
  std::vector<TaskId> feature_tasks, all;
  std::size_t next_tile = 0;
  for (const Image& image : run->block.images) {
    const TaskCost cost = FeatureTaskCost(*run, image);
    feature_tasks.push_back(
        plan.Add({.name = "features " + image.name,
                  .stage = "features",
                  .needs = {},
                  .cost = cost,
                  .memory_hint = MemoryHint(*run, cost.peak_bytes, "smaller images"),
                  .run = [run, id = image.id](TaskContext& context) { RunFeatureTask(*run, id, context); }}));
    all.push_back(feature_tasks.back());
    for (; next_tile < run->keys.tiles.size() && run->keys.tiles[next_tile].images.back() == image.id; ++next_tile)
      all.push_back(AddPairTask(run, next_tile, feature_tasks, plan));
  }
  const TaskId gathered(static_cast<std::uint32_t>(plan.size()));
  plan.Add({.name = "gather",
            .stage = "gather",
            .needs = std::move(all),
            .cost = {},
            .memory_hint = "",
            .run = [run, gathered](TaskContext& context) {
              context.Grow([run, gathered](engine::Plan& grown) { GrowOrientation(run, gathered, grown); });
            }});
  return plan;
}

}  // namespace rilievo::scheduling
