// Checkpoints of an orientation as artifacts: one for each step of its mapping, the last alone is kept.
#pragma once

#include <cstdint>

#include "base/checkpoints.h"
#include "engine/artifact_store.h"
#include "engine/plan.h"

namespace rilievo::scheduling {

/// Keyed by the orientation's key and the number of the step: equal keys have equal content, whoever writes them.
class OrientationCheckpoints : public Checkpoints {
 public:
  OrientationCheckpoints(const engine::ArtifactStore& store, const engine::ArtifactKey& orientation,
                         engine::TaskContext& context);
  std::optional<std::vector<std::byte>> Last() override;
  void Keep(std::span<const std::byte> state) override;

 private:
  const engine::ArtifactStore& store_;
  const engine::ArtifactKey& orientation_;
  engine::TaskContext& context_;
  std::uint64_t step_ = 0;  ///< of the last one kept
};

/// Removes what is there of an orientation that has been published. Does nothing where nothing can be removed.
void DropCheckpoints(const engine::ArtifactStore& store, const engine::ArtifactKey& orientation);

}  // namespace rilievo::scheduling
