// Walks the folders of a store.
#include "engine/artifact_files.h"

#include <algorithm>
#include <map>
#include <string>
#include <system_error>

#include "engine/durable_write.h"

namespace rilievo::engine {
namespace {

namespace fs = std::filesystem;

/// The artifacts that stand where their names say, by path.
std::map<fs::path, ArtifactKey> ArtifactsOf(const ArtifactStore& store) {
  std::map<fs::path, ArtifactKey> found;
  std::error_code ignored;
  for (const auto& folder : fs::directory_iterator(store.root(), ignored)) {
    const std::string stage = folder.path().filename().string();
    const bool may_be_stage =
        !stage.empty() && stage != "quarantine" &&
        std::all_of(stage.begin(), stage.end(), [](char c) { return (c >= 'a' && c <= 'z') || c == '-'; });
    if (!may_be_stage) continue;
    for (ArtifactKey& key : store.List(stage)) {
      const fs::path path = store.PathOf(key);
      found.emplace(path, std::move(key));
    }
  }
  return found;
}

}  // namespace

std::vector<StoredFile> FilesOf(const ArtifactStore& store) {
  const std::map<fs::path, ArtifactKey> artifacts = ArtifactsOf(store);
  const fs::path quarantine = store.root() / "quarantine";
  std::vector<StoredFile> files;
  std::error_code failed;
  for (fs::recursive_directory_iterator it(store.root(), failed), end; !failed && it != end; it.increment(failed)) {
    std::error_code vanished;
    if (!it->is_regular_file(vanished)) continue;
    StoredFile file{.path = it->path(), .key = {}};
    file.bytes = it->file_size(vanished);
    if (vanished) continue;
    if (const auto found = artifacts.find(file.path); found != artifacts.end()) {
      file.kind = StoredFile::Kind::kArtifact;
      file.key = found->second;
    } else if (IsStaleTemporary(file.path)) {
      file.kind = StoredFile::Kind::kStale;
    } else if (file.path.filename().string().find(".tmp-") != std::string::npos) {
      file.kind = StoredFile::Kind::kTemporary;
    } else if (file.path.parent_path() == quarantine) {
      file.kind = StoredFile::Kind::kQuarantined;
    }
    files.push_back(std::move(file));
  }
  std::sort(files.begin(), files.end(), [](const auto& a, const auto& b) { return a.path < b.path; });
  return files;
}

}  // namespace rilievo::engine
