// Gathers features and pairs for tracks, mapping and adjustment; the result as bytes.
#include "scheduling/orientation_task.h"

#include <algorithm>
#include <span>
#include <utility>

#include "base/serialize.h"
#include "block/io/serialize_block.h"
#include "scheduling/counted_io.h"
#include "scheduling/feature_tasks.h"
#include "scheduling/orient_costs.h"
#include "scheduling/orientation_checkpoints.h"
#include "scheduling/pair_tasks.h"
#include "stages/tracks/tie_points.h"

namespace rilievo::scheduling {
namespace {

using engine::TaskContext;

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
  for (const auto& tile : run.tiles)
    for (auto& geometry : LoadTile(tile->tile, ReadPublished(run.store, tile->key, "matches", context)))
      inputs.pairs.push_back(std::move(geometry));
  std::sort(inputs.pairs.begin(), inputs.pairs.end(), [](const auto& a, const auto& b) { return a.pair < b.pair; });
  return inputs;
}

void RunOrientationTask(OrientRun& run, TaskContext& context) {
  if (const auto payload = ReadCounted(run.store, run.keys.orientation, context)) {
    context.MarkReused();
    return;
  }
  const OrientationInputs inputs = LoadOrientationInputs(run, context);
  // A list of pairs need not hold a sequence's triplets.
  const bool has_triplets = run.options.network == Network::kSequence && run.options.listed.empty();
  const auto triplets = has_triplets
                            ? tracks::SequenceTriplets(run.block.images.size(), run.options.tracks.closed_sequence)
                            : std::vector<tracks::Triplet>{};
  const tracks::TiePoints ties =
      tracks::MakeTiePoints({run.block, inputs.keypoints, inputs.pairs, triplets}, run.options.tracks, context);
  context.ReportProgress(0.05);
  OrientationCheckpoints checkpoints(run.store, run.keys.orientation, context);
  mapping::Output output = mapping::Run({run.block, inputs.keypoints, inputs.colors, inputs.pairs, ties.tracks},
                                        run.options.mapping, checkpoints, context);
  run.images_taken_over = output.images_taken_over;
  OrientationResult result{
      std::move(output.models), std::move(output.unoriented), run.images, {}, std::move(output.warnings), ties.summary};
  std::erase_if(result.unoriented,
                [&](const UnorientedImage& u) { return !run.images[u.image.value].quarantine.empty(); });
  for (const auto& tile : run.tiles) result.pairs.insert(result.pairs.end(), tile->pairs.begin(), tile->pairs.end());
  std::sort(result.pairs.begin(), result.pairs.end(), [](const auto& a, const auto& b) { return a.pair < b.pair; });
  PublishCounted(run.store, run.keys.orientation, Serialize(result), context);
  DropCheckpoints(run.store, run.keys.orientation);
}

}  // namespace

void AddOrientationTask(const std::shared_ptr<OrientRun>& run, TaskId gathered, engine::Plan& plan) {
  std::uint64_t features = 0, inliers = 0;
  for (const auto& image : run->images) features += image.features;
  for (const auto& tile : run->tiles)
    for (const auto& pair : tile->pairs) inliers += pair.inliers;
  const TaskCost cost = OrientationTaskCost(*run, features, inliers);
  plan.Add({.name = "orientation",
            .stage = "orientation",
            .needs = {gathered},
            .cost = cost,
            .units = {static_cast<double>(run->block.images.size()), "images"},
            .memory_hint = MemoryHint(*run, cost.peak_bytes, "lower --max-features"),
            .run = [run](TaskContext& context) { RunOrientationTask(*run, context); }});
}

std::optional<OrientationResult> LoadOrientation(const engine::ArtifactStore& store, const OrientKeys& keys) {
  const auto payload = store.Read(keys.orientation);
  if (!payload) return std::nullopt;
  return DeserializeOrientation(*payload);
}

}  // namespace rilievo::scheduling
