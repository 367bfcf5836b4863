// The files of an artifact store as they lie on disk.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "engine/artifact_store.h"

namespace rilievo::engine {

struct StoredFile {
  enum class Kind : std::uint8_t {
    kArtifact,     ///< in its place
    kTemporary,    ///< being written, perhaps by another machine
    kStale,        ///< a temporary whose writer is gone
    kQuarantined,  ///< damaged, kept to be looked at
    kOther         ///< nothing that a store has
  };
  std::filesystem::path path;
  std::uint64_t bytes = 0;
  Kind kind = Kind::kOther;
  std::optional<ArtifactKey> key;  ///< of an artifact
};

/// Every file below the root of the store, by path; the files are not opened. What vanishes meanwhile is passed over.
std::vector<StoredFile> FilesOf(const ArtifactStore& store);

}  // namespace rilievo::engine
