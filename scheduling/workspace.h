// A workspace folder: the record of its current run and its artifact store.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "block/block.h"
#include "engine/artifact_store.h"
#include "scheduling/orient_options.h"

namespace rilievo::scheduling {

inline constexpr int kWorkspaceVersion = 1;
/// The trace of the last run that computed anything (docs/formats/trace.md).
inline constexpr const char* kTraceName = "trace.json";

/// What `run.json` holds (docs/formats/workspace.md): enough to find every artifact of the run again, without the
/// images.
struct RunRecord {
  std::filesystem::path images;  ///< image folder or scene file, absolute in memory, relative to the workspace on disk
  bool from_scene = false;
  Block block;
  OrientOptions options;
  std::string processor_level;  ///< of the machine that ran it: part of the keys (base/cpu.h)
  std::vector<std::string> warnings;
};

class Workspace {
 public:
  /// Opens or creates DIR. Throws Error(kVersion) for a workspace of another format, Error(kInvalidInput) for a folder
  /// that holds other things, Error(kIo) when it cannot be written.
  static Workspace OpenOrCreate(const std::filesystem::path& dir);
  /// Opens an existing workspace; throws Error(kNotFound) when DIR is none.
  static Workspace Open(const std::filesystem::path& dir);
  /// Looks at DIR, which may not exist, and creates nothing: to say what a run would find there. Refuses what
  /// OpenOrCreate refuses.
  static Workspace ForPlanning(const std::filesystem::path& dir);

  const std::filesystem::path& dir() const { return dir_; }
  const engine::ArtifactStore& store() const { return store_; }

  /// The record of the current run; none in a workspace that has had no run yet.
  std::optional<RunRecord> ReadRecord() const;
  void WriteRecord(const RunRecord& record) const;
  /// Replaces the record by that of a run that begins, and keeps the one of other images or options beside it until
  /// DropFormerRecord: what it has compared is found by it, also when this run is interrupted.
  void BeginRecord(const RunRecord& record) const;
  /// The record kept by BeginRecord; none when there is none that can be read.
  std::optional<RunRecord> ReadFormerRecord() const;
  void DropFormerRecord() const;
  /// Writes a file of the workspace durably, unless it holds that already: a finished workspace may be read-only.
  void WriteText(const std::string& name, const std::string& text) const;
  /// Removes temporary files of killed programs; what cannot be removed stays.
  void RemoveStaleTemporaries() const;
  /// Removes the reports of an earlier run, which no longer describe this workspace.
  void RemoveReports() const;

 private:
  std::optional<RunRecord> ReadRecordFile(const std::filesystem::path& path) const;
  Workspace(std::filesystem::path dir, engine::ArtifactStore store) : dir_(std::move(dir)), store_(std::move(store)) {}
  std::filesystem::path dir_;
  engine::ArtifactStore store_;
};

/// Bytes free for this user on the disk that holds `dir` (or its nearest existing parent).
std::uint64_t FreeDiskBytes(const std::filesystem::path& dir);

}  // namespace rilievo::scheduling
