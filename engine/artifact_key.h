// Builds the content key of an artifact from everything that its bytes depend on.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "base/hash.h"
#include "engine/artifact_store.h"

namespace rilievo::engine {

/// SHA-256 over stage name, stage version, then whatever is added, in order. Two keys are equal only when the same
/// things were added in the same order. Threads, memory and paths do not belong in a key.
class ArtifactKeyBuilder {
 public:
  /// `version` is raised whenever the stage's bytes change for equal inputs.
  ArtifactKeyBuilder(std::string stage, std::uint64_t version);

  /// OptionKeyText (base/option.h) of the stage's options.
  ArtifactKeyBuilder& AddOptions(std::string_view option_key_text);
  /// Digest of an input: the key of another artifact, or the content of a file.
  ArtifactKeyBuilder& AddInput(const Sha256Digest& digest);
  ArtifactKeyBuilder& AddText(std::string_view text);
  ArtifactKeyBuilder& AddNumber(std::uint64_t number);

  ArtifactKey Finish();

 private:
  std::string stage_;
  KeyHasher hasher_;
};

}  // namespace rilievo::engine
