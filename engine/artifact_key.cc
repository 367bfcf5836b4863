// Each kind of entry is preceded by a tag, so that an option text is never taken for an input.
#include "engine/artifact_key.h"

#include <utility>

namespace rilievo::engine {

ArtifactKeyBuilder::ArtifactKeyBuilder(std::string stage, std::uint64_t version) : stage_(std::move(stage)) {
  hasher_.Add(std::string_view("rilievo artifact")).Add(std::string_view(stage_)).Add(version);
}

ArtifactKeyBuilder& ArtifactKeyBuilder::AddOptions(std::string_view option_key_text) {
  hasher_.Add(std::string_view("options")).Add(option_key_text);
  return *this;
}

ArtifactKeyBuilder& ArtifactKeyBuilder::AddInput(const Sha256Digest& digest) {
  hasher_.Add(std::string_view("input")).Add(digest);
  return *this;
}

ArtifactKeyBuilder& ArtifactKeyBuilder::AddText(std::string_view text) {
  hasher_.Add(std::string_view("text")).Add(text);
  return *this;
}

ArtifactKeyBuilder& ArtifactKeyBuilder::AddNumber(std::uint64_t number) {
  hasher_.Add(std::string_view("number")).Add(number);
  return *this;
}

ArtifactKey ArtifactKeyBuilder::Finish() { return {stage_, hasher_.Finish()}; }

}  // namespace rilievo::engine
