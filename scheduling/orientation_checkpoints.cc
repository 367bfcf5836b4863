// Finding, keeping and dropping them.
#include "scheduling/orientation_checkpoints.h"

#include <algorithm>

#include "base/hash.h"
#include "scheduling/counted_io.h"

namespace rilievo::scheduling {
namespace {

using engine::ArtifactKey;

constexpr const char* kStage = "checkpoints";
/// Bumped when the state's layout changes; what it means is covered by the version of mapping in the orientation's key.
constexpr std::uint64_t kStateFormat = 1;
/// Far beyond any block: steps grow with the logarithm of the images of a component.
constexpr std::uint64_t kMostSteps = 20000;

ArtifactKey KeyOf(const ArtifactKey& orientation, std::uint64_t step) {
  KeyHasher hasher;
  hasher.Add("checkpoint").Add(kStateFormat).Add(orientation.digest).Add(step);
  return {kStage, hasher.Finish()};
}

/// The steps of which there is a file, ascending.
std::vector<std::uint64_t> StepsOnDisk(const engine::ArtifactStore& store, const ArtifactKey& orientation) {
  const std::vector<ArtifactKey> keys = store.List(kStage);
  std::vector<std::uint64_t> steps;
  for (std::uint64_t step = 1; step <= kMostSteps && steps.size() < keys.size(); ++step)
    if (std::binary_search(keys.begin(), keys.end(), KeyOf(orientation, step))) steps.push_back(step);
  return steps;
}

}  // namespace

OrientationCheckpoints::OrientationCheckpoints(const engine::ArtifactStore& store, const ArtifactKey& orientation,
                                               engine::TaskContext& context)
    : store_(store), orientation_(orientation), context_(context) {}

std::optional<std::vector<std::byte>> OrientationCheckpoints::Last() {
  const auto steps = StepsOnDisk(store_, orientation_);
  for (auto step = steps.rbegin(); step != steps.rend(); ++step) {
    auto payload = ReadCounted(store_, KeyOf(orientation_, *step), context_);
    if (!payload) continue;  // damaged: the one before it may be there
    step_ = *step;
    return payload;
  }
  return std::nullopt;
}

void OrientationCheckpoints::Keep(std::span<const std::byte> state) {
  if (step_ >= kMostSteps) return;
  ++step_;
  PublishCounted(store_, KeyOf(orientation_, step_), state, context_);
  if (step_ > 1) store_.Remove(KeyOf(orientation_, step_ - 1));
}

void DropCheckpoints(const engine::ArtifactStore& store, const ArtifactKey& orientation) {
  for (const std::uint64_t step : StepsOnDisk(store, orientation)) store.Remove(KeyOf(orientation, step));
}

}  // namespace rilievo::scheduling
