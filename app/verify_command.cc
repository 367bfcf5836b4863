// rilievo verify: checks every file of a workspace and changes nothing, unless it is asked to.
#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <map>
#include <nlohmann/json.hpp>

#include "app/command.h"
#include "app/run_flags.h"
#include "base/error.h"
#include "base/units.h"
#include "scheduling/workspace_contents.h"

namespace rilievo::app {
namespace {

namespace fs = std::filesystem;
using engine::StoredFile;

struct VerifyFlags {
  RunFlags run;
  std::string workspace;
  bool json = false, quarantine = false;
};

struct StageCounts {
  std::size_t files = 0, sound = 0, needed = 0, needed_there = 0;
  std::uint64_t bytes = 0;
};

struct Findings {
  std::map<std::string, StageCounts> stages;
  std::vector<scheduling::CheckedFile> damaged;
  std::vector<fs::path> strange;
  std::size_t quarantined = 0, temporaries = 0;
  bool run_known = false;  ///< run.json says what is needed
};

scheduling::Workspace OpenToCheck(const std::string& dir) {
  std::error_code failed;
  if (!fs::is_directory(dir, failed) ||
      (!fs::exists(fs::path(dir) / "run.json") && !fs::exists(fs::path(dir) / "artifacts")))
    throw Error(ErrorCode::kNotFound, dir, "is no workspace folder", "give the folder that orient --workspace made");
  return scheduling::Workspace::ForPlanning(dir);
}

void CountNeeded(const scheduling::Workspace& workspace, const std::vector<StoredFile>& files,
                 const std::vector<std::string>& reasons, Findings& findings) {
  const auto record = workspace.ReadRecord();
  if (!record) return;
  findings.run_known = true;
  const auto needed = scheduling::KeysNeededBy(*record, engine::ArtifactStore::ForChecking(workspace.store().root()));
  for (const auto& key : needed.keys) ++findings.stages[key.stage].needed;
  for (std::size_t i = 0; i < files.size(); ++i)
    if (files[i].key && reasons[i].empty() && needed.Holds(*files[i].key))
      ++findings.stages[files[i].key->stage].needed_there;
}

Findings Check(const scheduling::Workspace& workspace, const PlanRunner& runner) {
  Findings findings;
  const std::vector<StoredFile> files = engine::FilesOf(workspace.store());
  std::vector<std::string> reasons;
  engine::Plan plan;
  scheduling::AddCheckTasks(workspace.store(), files, reasons, plan);
  runner.Run(plan);
  for (auto& record : scheduling::CheckRecords(workspace))
    if (!record.reason.empty()) findings.damaged.push_back(std::move(record));
  const bool record_sound = findings.damaged.empty() || findings.damaged.front().path.filename() != "run.json";
  for (std::size_t i = 0; i < files.size(); ++i) {
    findings.quarantined += files[i].kind == StoredFile::Kind::kQuarantined ? 1 : 0;
    findings.temporaries +=
        files[i].kind == StoredFile::Kind::kTemporary || files[i].kind == StoredFile::Kind::kStale ? 1 : 0;
    if (files[i].kind == StoredFile::Kind::kOther) findings.strange.push_back(files[i].path);
    if (!files[i].key) continue;
    StageCounts& stage = findings.stages[files[i].key->stage];
    ++stage.files;
    stage.bytes += files[i].bytes;
    stage.sound += reasons[i].empty() ? 1 : 0;
    if (!reasons[i].empty()) findings.damaged.push_back({files[i].path, reasons[i]});
  }
  if (record_sound) CountNeeded(workspace, files, reasons, findings);
  return findings;
}

/// Damaged artifacts out of the way: reading one through a store that may write does it.
void MoveDamaged(const scheduling::Workspace& workspace) {
  const engine::ArtifactStore store(workspace.store().root());
  for (const StoredFile& file : engine::FilesOf(store))
    if (file.key && !store.Verify(*file.key)) store.Read(*file.key);
}

void PrintFindings(const Findings& findings, bool quarantine) {
  fmt::print("{:<12} {:>9} {:>10} {:>8} {:>8}  {}\n", "stage", "artifacts", "size", "sound", "damaged",
             findings.run_known ? "of the last run" : "");
  for (const auto& [name, s] : findings.stages) {
    fmt::print("{:<12} {:>9} {:>10} {:>8} {:>8}", name, s.files, FormatBytes(s.bytes), s.sound, s.files - s.sound);
    fmt::print("{}\n", findings.run_known ? fmt::format("  {} of {}", s.needed_there, s.needed) : "");
  }
  if (findings.quarantined > 0) fmt::print("{} quarantined files (rilievo clean removes them)\n", findings.quarantined);
  if (findings.temporaries > 0)
    fmt::print("{} temporary files: being written, or left by a program that was killed\n", findings.temporaries);
  for (const auto& path : findings.strange) fmt::print("not of this program: {}\n", path.string());
  for (const auto& file : findings.damaged) fmt::print("DAMAGED {}: {}\n", file.path.string(), file.reason);
  if (findings.damaged.empty())
    fmt::print("all sound\n");
  else if (quarantine)
    fmt::print(
        "damaged artifacts were moved to artifacts/quarantine; run the same orient command to make them again\n");
  else
    fmt::print("run the same orient command: it makes what it needs of them again\n");
}

void PrintJson(const Findings& findings) {
  nlohmann::json out = {{"format", "rilievo-verification"},    {"version", 1},
                        {"sound", findings.damaged.empty()},   {"stages", nlohmann::json::array()},
                        {"damaged", nlohmann::json::array()},  {"quarantined", findings.quarantined},
                        {"temporaries", findings.temporaries}, {"other_files", nlohmann::json::array()}};
  for (const auto& [name, s] : findings.stages) {
    out["stages"].push_back({{"name", name}, {"artifacts", s.files}, {"bytes", s.bytes}, {"sound", s.sound}});
    out["stages"].back()["needed"] = findings.run_known ? nlohmann::json(s.needed) : nlohmann::json();
    out["stages"].back()["needed_there"] = findings.run_known ? nlohmann::json(s.needed_there) : nlohmann::json();
  }
  for (const auto& file : findings.damaged)
    out["damaged"].push_back({{"path", file.path.string()}, {"reason", file.reason}});
  for (const auto& path : findings.strange) out["other_files"].push_back(path.string());
  fmt::print("{}\n", out.dump(1, ' ', false, nlohmann::json::error_handler_t::replace));
}

int RunVerify(VerifyFlags flags, ProgramContext& context) {
  flags.run.quiet |= flags.json;
  const PlanRunner runner(flags.run, context);
  const auto workspace = OpenToCheck(flags.workspace);
  const Findings findings = Check(workspace, runner);
  if (flags.quarantine && !findings.damaged.empty()) MoveDamaged(workspace);
  if (flags.json)
    PrintJson(findings);
  else
    PrintFindings(findings, flags.quarantine);
  return findings.damaged.empty() ? kExitDone : kExitFailed;
}

}  // namespace

void AddVerifyCommand(CLI::App& app, ProgramContext& context) {
  auto flags = std::make_shared<VerifyFlags>();
  CLI::App* command = app.add_subcommand(
      "verify",
      "Check every artifact of a workspace (header, length, checksum) and its records; exit code 1 if any is damaged");
  command->add_option("workspace", flags->workspace, "Workspace folder")->required()->type_name("DIR");
  command->add_flag("--quarantine", flags->quarantine,
                    "Move damaged artifacts to artifacts/quarantine, as a run would; default: only report them");
  command->add_flag("--json", flags->json, "JSON for programs (docs/formats/verification.md); default: text");
  AddLimitFlags(*command, flags->run);
  command->footer(
      "Sizes in B to GiB. Reads every file once, 1 MiB at a time and thread.\nExample:\n  rilievo verify block/ "
      "--threads 2");
  command->callback([flags, &context] { context.exit_code = RunVerify(*flags, context); });
}

}  // namespace rilievo::app
