// rilievo orient: from photographs and calibration to an oriented block in a workspace.
#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>

#include "app/command.h"
#include "app/inputs.h"
#include "app/run_flags.h"
#include "engine/artifact_store.h"
#include "scheduling/orient_plan.h"
#include "scheduling/workspace.h"
#include "stages/reporting/orientation_report.h"

namespace rilievo::app {
namespace {

struct OrientFlags {
  InputFlags inputs;
  RunFlags run;
  scheduling::OrientOptions options;
  std::string workspace;
};

void RefuseWhatDoesNotFit(const scheduling::OrientRun& run, const Limits& limits, const std::filesystem::path& dir) {
  const auto summary = scheduling::Summarize(run, limits.budget_bytes, limits.threads);
  const std::uint64_t free_bytes = scheduling::FreeDiskBytes(dir);
  if (summary.disk_bytes + 16 * kMebibyte > free_bytes)
    throw Error(ErrorCode::kDiskFull, dir.string(),
                fmt::format("the run needs about {} on this disk and {} are free", FormatBytes(summary.disk_bytes + 16 * kMebibyte), FormatBytes(free_bytes)),
                "free some space, or give a --workspace on another disk");
}

void WriteReports(const scheduling::Workspace& workspace, const Block& block, const OrientationResult& result,
                  const reporting::Report& report, const std::vector<std::string>& warnings) {
  const std::string text = reporting::ToText(report, block, result, warnings);
  const std::string json = reporting::ToJson(report, block, result, warnings).dump(1) + "\n";
  engine::WriteFileDurably(workspace.dir() / "report.txt", std::as_bytes(std::span(text)));
  engine::WriteFileDurably(workspace.dir() / "report.json", std::as_bytes(std::span(json)));
}

/// The lines a person wants at the end; the whole report is in the workspace.
void PrintResult(const reporting::Report& report, const OrientationResult& result, const scheduling::Workspace& workspace) {
  fmt::print("oriented {} of {} images", report.oriented, report.images);
  if (report.models.size() > 1) fmt::print(" in {} separate components", report.models.size());
  fmt::print("\n");
  for (const auto& m : report.models)
    fmt::print("  {} images, {} object points, {} rays, sigma0 {:.3f} px, RMS residual {:.3f} px\n", m.images.size(), m.points, m.rays, m.sigma0_px, m.rms_px);
  if (!result.unoriented.empty()) fmt::print("  {} images not oriented: see the report\n", result.unoriented.size());
  if (!report.quarantined.empty()) fmt::print("  {} files quarantined: see the report\n", report.quarantined.size());
  fmt::print("report: {}\n", (workspace.dir() / "report.txt").string());
}

/// The one line for a block in which nothing could be oriented.
[[noreturn]] void FailUnoriented(const Block& block, const OrientationResult& result, const reporting::Report& report,
                                 const scheduling::Workspace& workspace) {
  std::string why = "no image could be oriented";
  if (!result.unoriented.empty())
    why += ": " + block.image(result.unoriented.front().image).name + ": " + result.unoriented.front().reason;
  else if (!report.quarantined.empty())
    why += ": " + report.quarantined.front().name + ": " + report.quarantined.front().reason;
  throw Error(ErrorCode::kInvalidInput, "", why, "all reasons are in " + (workspace.dir() / "report.txt").string());
}

int RunOrient(const OrientFlags& flags, const engine::StopSource& stop) {
  scheduling::Validate(flags.options);
  PlanRunner runner(flags.run, ResolveLimits(flags.run), stop);
  Inputs inputs = LoadInputs(flags.inputs, runner);
  const Limits& limits = runner.limits();
  if (inputs.block.images.size() < 2)
    throw Error(ErrorCode::kInvalidInput, inputs.images.string(), "has one usable image, an orientation needs at least two",
                inputs.block.quarantined.empty() ? "add overlapping photographs"
                                                 : inputs.block.quarantined.front().name + ": " + inputs.block.quarantined.front().reason);
  if (!flags.run.quiet)
    for (const auto& warning : inputs.warnings) fmt::print(stderr, "rilievo: WARNING: {}\n", warning);

  scheduling::OrientOptions options = flags.options;
  options.network = flags.inputs.network == "sequence" ? scheduling::Network::kSequence : scheduling::Network::kSparse;
  const auto workspace = scheduling::Workspace::OpenOrCreate(flags.workspace);
  workspace.WriteRecord({inputs.images, inputs.from_scene, inputs.block, options, inputs.warnings});

  auto run = std::make_shared<scheduling::OrientRun>(inputs.block, *inputs.pixels, workspace.store(), options);
  std::optional<OrientationResult> result = scheduling::LoadOrientation(workspace.store(), run->keys);
  if (result) {
    if (!flags.run.quiet) fmt::print("nothing to do: this orientation is already in {}\n", workspace.dir().string());
  } else {
    RefuseWhatDoesNotFit(*run, limits, workspace.dir());
    engine::Plan plan = scheduling::MakeOrientPlan(run);
    const engine::ExecutionReport executed = runner.Run(plan);
    for (const auto& outcome : executed.outcomes)
      if (outcome.state == engine::TaskState::kFailed) throw Error(ErrorCode::kInternal, "", outcome.error);
    result = scheduling::LoadOrientation(workspace.store(), run->keys);
    if (!result) throw Error(ErrorCode::kIo, workspace.dir().string(), "the orientation was written but cannot be read back", "check the disk");
  }
  const reporting::Report report = reporting::Summarize(inputs.block, *result);
  WriteReports(workspace, inputs.block, *result, report, inputs.warnings);
  if (report.models.empty()) FailUnoriented(inputs.block, *result, report, workspace);
  if (!flags.run.quiet) PrintResult(report, *result, workspace);
  return kExitDone;
}

/// What a run would do, as text for people.
int RunPlan(const OrientFlags& flags, const engine::StopSource& stop) {
  scheduling::Validate(flags.options);
  PlanRunner runner(flags.run, ResolveLimits(flags.run), stop);
  Inputs inputs = LoadInputs(flags.inputs, runner);
  const Limits& limits = runner.limits();
  for (const auto& warning : inputs.warnings) fmt::print(stderr, "rilievo: WARNING: {}\n", warning);
  scheduling::OrientOptions options = flags.options;
  options.network = flags.inputs.network == "sequence" ? scheduling::Network::kSequence : scheduling::Network::kSparse;
  const auto workspace = scheduling::Workspace::ForPlanning(flags.workspace);
  const scheduling::OrientRun run(inputs.block, *inputs.pixels, workspace.store(), options);
  const auto s = scheduling::Summarize(run, limits.budget_bytes, limits.threads);
  double megapixels = 0;
  for (const Image& image : inputs.block.images) megapixels += 1e-6 * image.width_px * image.height_px;
  fmt::print("images      {} ({:.1f} Mpx in all), {} cameras, {} files quarantined\n", s.images, megapixels, inputs.block.cameras.size(), inputs.block.quarantined.size());
  fmt::print("pairs       {} ({})\n", s.pairs, flags.inputs.network);
  fmt::print("tasks       {} features, {} pair tiles, 1 orientation\n", s.feature_tasks, s.pair_tasks);
  fmt::print("done        {} features, {} pair tiles, {} orientation\n", s.feature_tasks_done, s.pair_tasks_done, s.orientation_done ? 1 : 0);
  fmt::print("memory      {} limit; the largest task needs {} ({}), the program itself {}\n", FormatBytes(limits.memory_bytes), FormatBytes(s.peak_bytes), s.peak_task, FormatBytes(kProcessReserveBytes));
  const auto dir = flags.workspace.empty() ? std::filesystem::current_path() : std::filesystem::path(flags.workspace);
  fmt::print("disk        about {} to write, {} free\n", FormatBytes(s.disk_bytes), FormatBytes(scheduling::FreeDiskBytes(dir)));
  fmt::print("time        about {} with {} threads ({} of one core)\n", FormatDuration(s.time_s), limits.threads, FormatDuration(s.work_s));
  const bool fits = s.peak_bytes <= limits.budget_bytes;
  if (!fits)
    throw Error(ErrorCode::kOutOfMemoryBudget, "", fmt::format("'{}' needs {} and --memory leaves {}", s.peak_task, FormatBytes(s.peak_bytes), FormatBytes(limits.budget_bytes)),
                fmt::format("use --memory {}MiB or more", (s.peak_bytes + kProcessReserveBytes) / kMebibyte + 1));
  return kExitDone;
}

CLI::App* AddRunCommand(CLI::App& app, const std::string& name, const std::string& description, OrientFlags& flags, bool workspace_required) {
  CLI::App* command = app.add_subcommand(name, description);
  AddInputFlags(*command, flags.inputs);
  auto* workspace = command->add_option("--workspace", flags.workspace, "Folder for all results; made when it is not there; running again continues in it")->type_name("DIR");
  if (workspace_required) workspace->required();
  AddRunFlags(*command, flags.run);
  AddStageOptions(*command, flags.options);
  return command;
}

}  // namespace

void AddOrientCommand(CLI::App& app, ProgramContext& context) {
  auto flags = std::make_shared<OrientFlags>();
  CLI::App* command = AddRunCommand(app, "orient", "Orient a block of photographs: exterior orientation, object points, report", *flags, true);
  command->footer("Example:\n  rilievo orient photos/ --calibration camera.toml --workspace block/ --memory 4GiB");
  command->callback([flags, &context] { context.exit_code = RunOrient(*flags, context.stop); });
}

void AddPlanCommand(CLI::App& app, ProgramContext& context) {
  auto flags = std::make_shared<OrientFlags>();
  CLI::App* command = AddRunCommand(app, "plan", "Say what orient would do: pairs, tasks, peak memory, disk space, time", *flags, false);
  command->footer("Example:\n  rilievo plan photos/ --calibration camera.toml --memory 2GiB");
  command->callback([flags, &context] { context.exit_code = RunPlan(*flags, context.stop); });
}

}  // namespace rilievo::app
