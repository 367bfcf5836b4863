// Detects, publishes and reads back the features of images.
#include "scheduling/feature_tasks.h"

#include <utility>

#include "base/serialize.h"
#include "block/coverage.h"
#include "block/io/serialize_block.h"
#include "scheduling/counted_io.h"
#include "scheduling/orient_costs.h"
#include "stages/images/masks.h"

namespace rilievo::scheduling {
namespace {

using engine::ArtifactKey;
using engine::TaskContext;

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
  if (const auto payload = ReadCounted(run.store, key, context)) {
    summary = Summarise(image, DeserializeFeatureArtifact(*payload));
    context.MarkReused();
    return;
  }
  const FeatureArtifact artifact = ComputeFeatures(run, image, context);
  summary = Summarise(image, artifact);
  PublishCounted(run.store, key, Serialize(artifact), context);
}

}  // namespace

TaskId AddFeatureTask(const std::shared_ptr<OrientRun>& run, const Image& image, engine::Plan& plan) {
  TaskCost cost = FeatureTaskCost(*run, image);
  if (run->store.Exists(run->keys.features[image.id.value])) cost.work = 0;
  return plan.Add({.name = "features " + image.name,
                   .stage = "features",
                   .needs = {},
                   .cost = cost,
                   .units = {1e-6 * image.width_px * image.height_px, "Mpx"},
                   .memory_hint = MemoryHint(*run, cost.peak_bytes, "smaller images"),
                   .run = [run, id = image.id](TaskContext& context) { RunFeatureTask(*run, id, context); }});
}

ImageFeatures LoadFeatures(const OrientRun& run, ImageId id, TaskContext& context) {
  const auto payload = ReadPublished(run.store, run.keys.features[id.value], "features", context);
  return DeserializeFeatureArtifact(payload).features;
}

}  // namespace rilievo::scheduling
