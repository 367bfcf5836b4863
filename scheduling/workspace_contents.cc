// Sorts the files of a workspace into needed, sound and neither.
#include "scheduling/workspace_contents.h"

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "base/units.h"
#include "engine/durable_write.h"
#include "scheduling/guided_plan.h"
#include "scheduling/orient_keys.h"

namespace rilievo::scheduling {
namespace {

namespace fs = std::filesystem;
using engine::StoredFile;

/// Why an artifact is not sound; empty when it is.
std::string ReasonAgainst(const engine::ArtifactStore& store, const engine::ArtifactKey& key) {
  try {
    if (store.Verify(key)) return {};
    return store.Exists(key) ? "its checksum does not hold" : "its header or its length does not hold";
  } catch (const Error& error) {
    return error.message();
  }
}

std::string ReasonAgainstJson(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return "cannot be read";
  return nlohmann::json::accept(in) ? "" : "is no JSON: cut off or damaged";
}

}  // namespace

NeededKeys KeysNeededBy(const RunRecord& record, const engine::ArtifactStore& store) {
  OrientKeys keys = ComputeKeys(record.block, record.options, record.processor_level);
  NeededKeys needed;
  if (!keys.tiles_complete) {
    FindGuidedTiles(record.block, record.options, store, keys);
    const auto guided = GuidedKeys(record.block, record.options, store, keys);
    needed.keys.insert(guided.begin(), guided.end());
  }
  needed.keys.insert(keys.features.begin(), keys.features.end());
  needed.keys.insert(keys.pairs.begin(), keys.pairs.end());
  needed.keys.insert(keys.orientation);
  needed.all_known = keys.tiles_complete;
  return needed;
}

void AddCheckTasks(const engine::ArtifactStore& store, const std::vector<StoredFile>& files,
                   std::vector<std::string>& reasons, engine::Plan& plan) {
  constexpr std::uint64_t kBytesATask = 32 * kMebibyte;
  constexpr std::size_t kFilesATask = 256;
  reasons.assign(files.size(), {});
  for (std::size_t begin = 0; begin < files.size();) {
    std::size_t end = begin;
    std::uint64_t bytes = 0;
    while (end < files.size() && end - begin < kFilesATask && bytes < kBytesATask) bytes += files[end++].bytes;
    plan.Add({.name = "check " + std::to_string(begin),
              .stage = "check",
              .needs = {},
              .cost = {2 * kMebibyte, 1e-4 + 1e-9 * static_cast<double>(bytes)},
              .units = {1e-6 * static_cast<double>(bytes), "MB"},
              .memory_hint = "raise --memory",
              .run = [&store, &files, &reasons, begin, end](engine::TaskContext& context) {
                for (std::size_t i = begin; i < end; ++i) {
                  context.ThrowIfStopped();
                  if (files[i].key) reasons[i] = ReasonAgainst(store, *files[i].key);
                  context.CountBytes(files[i].bytes, 0);
                }
              }});
    begin = end;
  }
}

std::vector<CheckedFile> CheckRecords(const Workspace& workspace) {
  std::vector<CheckedFile> checked;
  std::error_code ignored;
  for (const char* name : {"run.json", "report.json", kTraceName}) {
    const fs::path path = workspace.dir() / name;
    if (fs::exists(path, ignored)) checked.push_back({path, ReasonAgainstJson(path)});
    if (name != std::string("run.json") || checked.empty() || !checked.back().reason.empty()) continue;
    try {
      workspace.ReadRecord();
    } catch (const Error& error) {
      checked.back().reason = error.message();
    }
  }
  return checked;
}

std::vector<StoredFile> FilesToDrop(const Workspace& workspace, const NeededKeys& needed,
                                    const std::vector<StoredFile>& files) {
  std::vector<StoredFile> drop;
  for (const StoredFile& file : files) {
    const bool is_junk = file.kind == StoredFile::Kind::kStale || file.kind == StoredFile::Kind::kQuarantined;
    const bool may_be_needed =
        file.key && !needed.all_known && (file.key->stage == "pairs" || file.key->stage == "growth");
    if (is_junk || (file.key && !needed.Holds(*file.key) && !may_be_needed)) drop.push_back(file);
  }
  std::error_code failed;
  for (fs::directory_iterator it(workspace.dir(), failed), end; !failed && it != end; it.increment(failed)) {
    std::error_code vanished;
    if (!it->is_regular_file(vanished) || !engine::IsStaleTemporary(it->path())) continue;
    StoredFile file{.path = it->path(), .kind = StoredFile::Kind::kStale, .key = {}};
    file.bytes = it->file_size(vanished);
    drop.push_back(std::move(file));
  }
  return drop;
}

}  // namespace rilievo::scheduling
