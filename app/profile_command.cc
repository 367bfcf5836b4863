// rilievo profile: where the time, the bytes and the memory of the last run of a workspace went.
#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <span>

#include "app/command.h"
#include "app/profile_views.h"
#include "base/error.h"
#include "engine/artifact_store.h"
#include "engine/machine_peak.h"
#include "scheduling/workspace.h"

namespace rilievo::app {
namespace {

namespace fs = std::filesystem;

struct ProfileFlags {
  std::string path, html;
  bool json = false;
};

fs::path TraceOf(const std::string& path) {
  if (!fs::is_directory(path)) return path;
  const fs::path trace = scheduling::Workspace::Open(path).dir() / scheduling::kTraceName;
  if (!fs::exists(trace))
    throw Error(ErrorCode::kNotFound, path, "has no trace of a run yet",
                "run orient on it; a run that found everything done leaves none");
  return trace;
}

/// Measured here and now, which says something about the run only where it was on a processor of the same name.
engine::MachinePeak PeakFor(const engine::RecordedRun& run) {
  if (run.facts.processor != engine::ProcessorName()) return {};
  return {engine::MeasurePeak_per_s(KernelName::Arithmetic::kBytes),
          engine::MeasurePeak_per_s(KernelName::Arithmetic::kFloats)};
}

int RunProfileCommand(const ProfileFlags& flags) {
  const fs::path trace = TraceOf(flags.path);
  const engine::RecordedRun run = engine::ReadTrace(trace);
  if (run.tasks.empty())
    throw Error(ErrorCode::kInvalidInput, trace.string(), "tells of no task",
                "run orient again, and let it run a while");
  const engine::RunProfile profile = engine::ProfileOf(run, PeakFor(run));
  if (!flags.html.empty()) {
    const std::string page =
        ProfilePage(run, profile, fs::weakly_canonical(fs::absolute(flags.path)).filename().string());
    engine::WriteFileDurably(flags.html, std::as_bytes(std::span(page)));
  }
  if (flags.json)
    fmt::print("{}\n", ProfileJson(run, profile).dump(1, ' ', false, nlohmann::json::error_handler_t::replace));
  else
    fmt::print("{}", ProfileText(run, profile));
  return kExitDone;
}

}  // namespace

void AddProfileCommand(CLI::App& app, ProgramContext& context) {
  auto flags = std::make_shared<ProfileFlags>();
  CLI::App* command = app.add_subcommand(
      "profile",
      "Where a run's time went: per stage wall, CPU, rates, bytes, memory; kernels, critical path, idle gaps");
  command
      ->add_option("run", flags->path, "Workspace folder (its last run that computed anything), or a file of --trace")
      ->required()
      ->type_name("DIR|TRACE");
  command->add_flag("--json", flags->json, "JSON for programs (docs/formats/profile.md); default: text");
  command
      ->add_option(
          "--html", flags->html,
          "Also write a page with the tables and a timeline to zoom and pan; it needs no other file; default: none")
      ->type_name("FILE");
  command->footer(
      "Times in s, bytes in B to GiB, rates in Mpx/s, pairs/s or images/s, kernels in multiply-adds/s of one core.\n"
      "Example:\n  rilievo profile block/ --html block.html");
  command->callback([flags, &context] { context.exit_code = RunProfileCommand(*flags); });
}

}  // namespace rilievo::app
