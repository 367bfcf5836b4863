// What lies in a workspace: which of it the last run needs, and whether it is sound.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "engine/artifact_files.h"
#include "engine/plan.h"
#include "scheduling/workspace.h"

namespace rilievo::scheduling {

/// The artifacts of the run that run.json describes, as this version of the program names them; the images are not
/// looked at. `all_known` is false for a guided block that has not found all of its pairs: which tiles and rounds it
/// needs follows from results that are not there yet.
struct NeededKeys {
  std::set<engine::ArtifactKey> keys;
  bool all_known = true;
  bool Holds(const engine::ArtifactKey& key) const { return keys.contains(key); }
};
NeededKeys KeysNeededBy(const RunRecord& record, const engine::ArtifactStore& store);

/// One file that was looked at; an empty reason: sound.
struct CheckedFile {
  std::filesystem::path path;
  std::string reason;
};

/// Tasks that verify the artifacts among `files`: header, length and checksum, some files a task, 1 MiB of memory each.
/// reasons[i] is filled for files[i]. Both outlive the run of the plan.
void AddCheckTasks(const engine::ArtifactStore& store, const std::vector<engine::StoredFile>& files,
                   std::vector<std::string>& reasons, engine::Plan& plan);

/// run.json, report.json and trace.json, those that are there.
std::vector<CheckedFile> CheckRecords(const Workspace& workspace);

/// What is to go: artifacts that no current key needs, what is quarantined, and temporaries whose writers are gone, in
/// the store and beside run.json. Of an unfinished guided block all pairs and growth are kept.
std::vector<engine::StoredFile> FilesToDrop(const Workspace& workspace, const NeededKeys& needed,
                                            const std::vector<engine::StoredFile>& files);

}  // namespace rilievo::scheduling
