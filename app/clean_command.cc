// rilievo clean: drops what the last run of a workspace does not need.
#include <fmt/format.h>
#include <unistd.h>
#include <CLI/CLI.hpp>

#include <cerrno>
#include <map>
#include <nlohmann/json.hpp>

#include "app/command.h"
#include "base/error.h"
#include "base/units.h"
#include "engine/durable_write.h"
#include "scheduling/workspace_contents.h"
#include "scheduling/workspace_lock.h"

namespace rilievo::app {
namespace {

namespace fs = std::filesystem;
using engine::StoredFile;

struct CleanFlags {
  std::string workspace;
  bool dry_run = false, json = false;
};

struct Count {
  std::size_t files = 0;
  std::uint64_t bytes = 0;
  void Add(const StoredFile& file) {
    ++files;
    bytes += file.bytes;
  }
};

struct Cleaning {
  std::map<std::string, Count> dropped, kept;  ///< by stage
  bool all_known = true;
  std::string images_gone;  ///< where they were
};

std::string GroupOf(const StoredFile& file) {
  if (file.key) return file.key->stage;
  return file.kind == StoredFile::Kind::kQuarantined ? "quarantine" : "temporaries";
}

/// When nothing of the run is there but other results are, they are most likely those of another version of the
/// program: dropping them would throw away what that version still finds.
void RefuseToDropAll(const scheduling::NeededKeys& needed, const std::vector<StoredFile>& files, const fs::path& dir) {
  std::size_t artifacts = 0, current = 0;
  for (const StoredFile& file : files) {
    artifacts += file.key ? 1 : 0;
    current += file.key && needed.Holds(*file.key) ? 1 : 0;
  }
  if (artifacts > 0 && current == 0)
    throw Error(
        ErrorCode::kInvalidInput, dir.string(),
        fmt::format("none of its {} artifacts belongs to its last run as this version of the program names them",
                    artifacts),
        "run orient on it with this version first, or clean it with the version that made it");
}

scheduling::RunRecord RequireRecord(const scheduling::Workspace& workspace) {
  auto record = workspace.ReadRecord();
  if (!record) throw Error(ErrorCode::kNotFound, workspace.dir().string(), "holds no run", "run rilievo orient first");
  return std::move(*record);
}

void Drop(const StoredFile& file) {
  if (::unlink(file.path.c_str()) != 0 && errno != ENOENT)
    throw engine::DiskError(errno, file.path, "cannot be removed");
}

Cleaning Clean(const scheduling::Workspace& workspace, bool dry_run) {
  const auto lock = scheduling::WorkspaceLock::TryAlone(workspace.dir());
  if (!lock)
    throw Error(ErrorCode::kInvalidInput, workspace.dir().string(), "is being used by a run, or cleaned already",
                "wait until it has ended; nothing was removed");
  const scheduling::RunRecord record = RequireRecord(workspace);
  const auto needed = scheduling::KeysNeededBy(record, engine::ArtifactStore::ForChecking(workspace.store().root()));
  const std::vector<StoredFile> files = engine::FilesOf(workspace.store());
  RefuseToDropAll(needed, files, workspace.dir());
  Cleaning cleaning;
  cleaning.all_known = needed.all_known;
  std::error_code failed;
  if (!fs::exists(record.images, failed)) cleaning.images_gone = record.images.string();
  const auto drop = scheduling::FilesToDrop(workspace, needed, files);
  std::set<fs::path> dropped;
  for (const StoredFile& file : drop) {
    if (!dry_run) Drop(file);
    cleaning.dropped[GroupOf(file)].Add(file);
    dropped.insert(file.path);
  }
  for (const StoredFile& file : files)
    if (file.key && !dropped.contains(file.path)) cleaning.kept[file.key->stage].Add(file);
  return cleaning;
}

Count Sum(const std::map<std::string, Count>& counts) {
  Count sum;
  for (const auto& [name, count] : counts) {
    sum.files += count.files;
    sum.bytes += count.bytes;
  }
  return sum;
}

void PrintCleaning(const Cleaning& cleaning, bool dry_run) {
  std::map<std::string, std::pair<Count, Count>> rows;
  for (const auto& [name, count] : cleaning.kept) rows[name].first = count;
  for (const auto& [name, count] : cleaning.dropped) rows[name].second = count;
  const char* what = dry_run ? "to drop" : "dropped";
  fmt::print("{:<12} {:>8} {:>10} {:>8} {:>10}\n", "stage", "kept", "size", what, "size");
  for (const auto& [name, row] : rows)
    fmt::print("{:<12} {:>8} {:>10} {:>8} {:>10}\n", name, row.first.files, FormatBytes(row.first.bytes),
               row.second.files, FormatBytes(row.second.bytes));
  const Count kept = Sum(cleaning.kept), dropped = Sum(cleaning.dropped);
  fmt::print("{:<12} {:>8} {:>10} {:>8} {:>10}\n", "all", kept.files, FormatBytes(kept.bytes), dropped.files,
             FormatBytes(dropped.bytes));
  if (!cleaning.all_known)
    fmt::print(
        "the guided run is not finished, so which pairs it needs is not known: all pairs are kept; finish it with "
        "orient, then clean again\n");
  if (!cleaning.images_gone.empty())
    fmt::print(
        "the images are not at {} any more; what the last run made of them is kept. Where they are now, the same "
        "orient command finds it again\n",
        cleaning.images_gone);
  if (dry_run) fmt::print("nothing was removed (--dry-run)\n");
}

nlohmann::json CountsJson(const std::map<std::string, Count>& counts) {
  nlohmann::json out = nlohmann::json::object();
  for (const auto& [name, count] : counts) out[name] = {{"files", count.files}, {"bytes", count.bytes}};
  return out;
}

int RunClean(const CleanFlags& flags) {
  const Cleaning cleaning = Clean(scheduling::Workspace::Open(flags.workspace), flags.dry_run);
  if (flags.json)
    fmt::print("{}\n", nlohmann::json{{"format", "rilievo-cleaning"},
                                      {"version", 1},
                                      {"dry_run", flags.dry_run},
                                      {"kept", CountsJson(cleaning.kept)},
                                      {"dropped", CountsJson(cleaning.dropped)},
                                      {"pairs_known", cleaning.all_known},
                                      {"images_there", cleaning.images_gone.empty()}}
                           .dump(1));
  else
    PrintCleaning(cleaning, flags.dry_run);
  return kExitDone;
}

}  // namespace

void AddCleanCommand(CLI::App& app, ProgramContext& context) {
  auto flags = std::make_shared<CleanFlags>();
  CLI::App* command = app.add_subcommand(
      "clean",
      "Drop what the last run of a workspace does not need: results of other options, images and versions, what is "
      "quarantined, temporary files of killed programs");
  command->add_option("workspace", flags->workspace, "Workspace folder; no run may be using it")
      ->required()
      ->type_name("DIR");
  command->add_flag("--dry-run", flags->dry_run, "Only say what would go; default: remove it");
  command->add_flag("--json", flags->json, "JSON for programs (docs/formats/workspace.md); default: text");
  command->footer(
      "Sizes in B to GiB. The same orient command finds everything done afterwards.\n"
      "Example:\n  rilievo clean block/ --dry-run");
  command->callback([flags, &context] { context.exit_code = RunClean(*flags); });
}

}  // namespace rilievo::app
