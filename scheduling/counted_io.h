// Reading and publishing artifacts inside tasks, their bytes counted for the trace.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "engine/artifact_store.h"
#include "engine/plan.h"

namespace rilievo::scheduling {

inline std::optional<std::vector<std::byte>> ReadCounted(const engine::ArtifactStore& store,
                                                         const engine::ArtifactKey& key, engine::TaskContext& context) {
  auto payload = store.Read(key);
  if (payload) context.CountBytes(payload->size(), 0);
  return payload;
}

/// Throws Error(kUnreadable) naming `what` for an artifact that an earlier task of this run has published.
inline std::vector<std::byte> ReadPublished(const engine::ArtifactStore& store, const engine::ArtifactKey& key,
                                            const char* what, engine::TaskContext& context) {
  auto payload = ReadCounted(store, key, context);
  if (!payload)
    throw Error(ErrorCode::kUnreadable, store.PathOf(key).string(),
                std::string(what) + " were damaged or removed during the run", "run the same command again");
  return std::move(*payload);
}

inline void PublishCounted(const engine::ArtifactStore& store, const engine::ArtifactKey& key,
                           std::span<const std::byte> payload, engine::TaskContext& context) {
  store.Publish(key, payload);
  context.CountBytes(0, payload.size());
}

}  // namespace rilievo::scheduling
