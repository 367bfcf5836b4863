// rilievo orient: from photographs and calibration to an oriented block in a workspace.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "app/command.h"
#include "app/inputs.h"
#include "app/pair_inputs.h"
#include "app/run_flags.h"
#include "base/cpu.h"
#include "base/units.h"
#include "scheduling/former_pairs.h"
#include "scheduling/orient_costs.h"
#include "scheduling/orient_forecast.h"
#include "scheduling/orient_plan.h"
#include "scheduling/orientation_checkpoints.h"
#include "scheduling/workspace.h"
#include "scheduling/workspace_lock.h"
#include "stages/reporting/orientation_report.h"

namespace rilievo::app {
namespace {

struct OrientFlags {
  InputFlags inputs;
  PairFlags pairs;
  RunFlags run;
  scheduling::OrientOptions options;
  std::string workspace, options_file;
  std::string until = "orientation";
  int strip_width_px = 0;
};

scheduling::OrientOptions OptionsOf(const OrientFlags& flags) {
  scheduling::OrientOptions options = flags.options;
  options.network = NetworkOf(flags.pairs);
  scheduling::Validate(options);
  return options;
}

/// The inputs of a run, with what makes them unusable refused.
Inputs LoadUsableInputs(const OrientFlags& flags, PlanRunner& runner, ProgramContext& context) {
  Inputs inputs = LoadInputs(flags.inputs, runner);
  if (inputs.block.images.size() < 2)
    throw Error(ErrorCode::kInvalidInput, inputs.images.string(),
                "has one usable image, an orientation needs at least two",
                inputs.block.quarantined.empty()
                    ? "add overlapping photographs"
                    : inputs.block.quarantined.front().name + ": " + inputs.block.quarantined.front().reason);
  if (!flags.run.quiet)
    for (const auto& warning : inputs.warnings) PrintWarning(context, warning);
  return inputs;
}

void WriteReports(const scheduling::Workspace& workspace, const Block& block, const OrientationResult& result,
                  const reporting::Report& report, const std::vector<std::string>& warnings) {
  workspace.WriteText("report.txt", reporting::ToText(report, block, result, warnings));
  workspace.WriteText("report.json", reporting::ToJson(report, block, result, warnings).dump(1) + "\n");
}

/// The lines a person wants at the end; the whole report is in the workspace.
void PrintResult(const reporting::Report& report, const OrientationResult& result,
                 const scheduling::Workspace& workspace) {
  fmt::print("oriented {} of {} images", report.oriented, report.images);
  if (report.models.size() > 1) fmt::print(" in {} separate components", report.models.size());
  fmt::print("\n");
  for (const auto& m : report.models)
    fmt::print("  {} images, {} object points, {} rays, sigma0 {:.3f} px, RMS residual {:.3f} px\n", m.images.size(),
               m.points, m.rays, m.sigma0_px, m.rms_px);
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

/// What was matched, and the bytes that it moved from and to disk.
void PrintPairs(const scheduling::OrientRun& run, const engine::Plan& plan, const engine::ExecutionReport& report) {
  std::size_t pairs = 0, verified = 0, matched = 0;
  for (const auto& tile : run.tiles) {
    pairs += tile->pairs.size();
    matched += tile->pairs.size() - tile->taken_over;
    for (const PairSummary& pair : tile->pairs) verified += pair.model != TwoViewModel::kRejected ? 1 : 0;
  }
  std::uint64_t read_bytes = 0, written_bytes = 0;
  for (const char* stage : {"blocks", "pairs"}) {
    for (const TaskId id : plan.FindByStage(stage)) {
      read_bytes += report.outcomes[id.value].read_bytes;
      written_bytes += report.outcomes[id.value].written_bytes;
    }
  }
  fmt::print("{} pairs compared ({} of them now), {} verified", pairs, matched, verified);
  if (matched > 0)
    fmt::print("; {} read and {} written, {} a pair", FormatBytes(read_bytes), FormatBytes(written_bytes),
               FormatBytes((read_bytes + written_bytes) / matched));
  fmt::print("\n");
}

/// Runs what is missing and reads the result back; none when the run ends with the pairs.
std::optional<OrientationResult> Execute(const std::shared_ptr<scheduling::OrientRun>& run, const PlanRunner& runner,
                                         const scheduling::Workspace& workspace, bool quiet) {
  engine::Plan plan = scheduling::MakeOrientPlan(run);
  scheduling::OrientForecast forecast(*run, runner.limits().threads);
  const engine::ExecutionReport report = runner.Run(plan, {.kept_trace = workspace.dir() / scheduling::kTraceName,
                                                           .forecast = [&] { return forecast.Forecast(); },
                                                           .forecast_observer = &forecast});
  if (!quiet) PrintPairs(*run, plan, report);
  if (!quiet && run->images_taken_over > 0)
    fmt::print("mapping went on from its last checkpoint, with {} of {} images\n", run->images_taken_over,
               run->block.images.size());
  if (run->goal == scheduling::Goal::kPairs) return std::nullopt;
  auto result = scheduling::LoadOrientation(run->store, run->keys);
  if (!result)
    throw Error(ErrorCode::kIo, workspace.dir().string(), "the orientation was written but cannot be read back",
                "check the disk");
  return result;
}

/// Writes and prints what an orientation says.
void Report(const Inputs& inputs, const OrientationResult& result, const scheduling::Workspace& workspace, bool quiet,
            ProgramContext& context) {
  const reporting::Report report = reporting::Summarize(inputs.block, result);
  WriteReports(workspace, inputs.block, result, report, inputs.warnings);
  if (!quiet)
    for (const auto& warning : result.warnings) PrintWarning(context, warning);
  if (report.models.empty()) FailUnoriented(inputs.block, result, report, workspace);
  if (!quiet) PrintResult(report, result, workspace);
}

/// A run as the flags ask for it; `options` get the pairs that come from outside.
scheduling::OrientRun PlannedRun(const OrientFlags& flags, scheduling::OrientOptions& options, Inputs& inputs,
                                 const scheduling::Workspace& workspace, const PlanRunner& runner,
                                 ProgramContext& context) {
  const std::size_t known = inputs.warnings.size();
  ListPairs(flags.pairs, inputs, options);
  if (!flags.run.quiet)
    for (std::size_t i = known; i < inputs.warnings.size(); ++i) PrintWarning(context, inputs.warnings[i]);
  scheduling::OrientRun run(inputs.block, *inputs.pixels, inputs.masks.get(), workspace.store(), options,
                            runner.overhead_bytes());
  run.budget_bytes = runner.limits().budget_bytes;
  run.strip_width_px = flags.strip_width_px;
  run.goal = flags.until == "pairs" ? scheduling::Goal::kPairs : scheduling::Goal::kOrientation;
  return run;
}

int RunOrient(const OrientFlags& flags, ProgramContext& context) {
  scheduling::OrientOptions options = OptionsOf(flags);
  PlanRunner runner(flags.run, context);
  const auto found = scheduling::Workspace::ForPlanning(flags.workspace);
  // From before the first look at its artifacts: `clean` removes what run.json does not tell of.
  std::optional<scheduling::WorkspaceLock> use;
  const auto lock = [&] {
    use.emplace(scheduling::WorkspaceLock::Share(found.dir(), [&] {
      if (!flags.run.quiet) PrintWarning(context, found.dir().string() + " is being cleaned: waiting until it is done");
    }));
  };
  if (std::filesystem::exists(found.dir())) lock();
  Inputs inputs = LoadUsableInputs(flags, runner, context);
  const scheduling::OrientRun planned = PlannedRun(flags, options, inputs, found, runner, context);
  std::optional<OrientationResult> result = scheduling::LoadOrientation(found.store(), planned.keys);
  bool done = result.has_value();
  if (!result) {
    const auto summary = scheduling::Summarize(planned, runner.limits().budget_bytes, runner.limits().threads);
    done = scheduling::IsDone(summary, planned.goal);
    scheduling::RefuseWhatCannotFit(summary, runner.limits().budget_bytes, runner.overhead_bytes(), found.dir());
  }
  const scheduling::RunRecord record{
      inputs.images, inputs.from_scene, inputs.block, options, std::string(ProcessorLevel()), inputs.warnings};
  if (done) {
    found.RemoveStaleTemporaries();
    found.DropFormerRecord();
    if (result) scheduling::DropCheckpoints(found.store(), planned.keys.orientation);
    found.WriteRecord(record);
    if (!flags.run.quiet)
      fmt::print("nothing to do: {} already in {}\n", result ? "this orientation is" : "these pairs are",
                 found.dir().string());
  } else {
    const auto workspace = scheduling::Workspace::OpenOrCreate(flags.workspace);
    if (!use) lock();
    workspace.RemoveReports();
    workspace.BeginRecord(record);
    const auto run = std::make_shared<scheduling::OrientRun>(planned, workspace.store());
    if (const auto former = workspace.ReadFormerRecord())
      run->former = std::make_shared<const scheduling::FormerPairs>(*former, workspace.store());
    result = Execute(run, runner, workspace, flags.run.quiet);
    workspace.DropFormerRecord();
  }
  if (result) Report(inputs, *result, found, flags.run.quiet, context);
  return kExitDone;
}

void PrintPlan(const scheduling::PlanSummary& s, const OrientFlags& flags, const Inputs& inputs,
               const PlanRunner& runner, const std::filesystem::path& dir) {
  double megapixels = 0;
  for (const Image& image : inputs.block.images) megapixels += 1e-6 * image.width_px * image.height_px;
  fmt::print("images      {} ({:.1f} Mpx in all), {} camera{}, {} files quarantined\n", s.images, megapixels,
             inputs.block.cameras.size(), inputs.block.cameras.size() == 1 ? "" : "s", inputs.block.quarantined.size());
  if (s.pairs_known)
    fmt::print("pairs       {} ({})\n", s.pairs, flags.pairs.network);
  else
    fmt::print("pairs       at most {} ({}), {} known so far; time and disk from usual shares\n", s.pairs_at_most,
               flags.pairs.network, s.pairs);
  fmt::print("tasks       {} features, {} pair tiles{}{}\n", s.feature_tasks, s.pair_tasks,
             s.pairs_known ? "" : " and more", flags.until == "pairs" ? "" : ", 1 orientation");
  fmt::print("done        {} features, {} pair tiles, {} orientation\n", s.feature_tasks_done, s.pair_tasks_done,
             s.orientation_done ? 1 : 0);
  fmt::print("memory      {} allowed; the program itself {}", FormatBytes(runner.limits().memory_bytes),
             FormatBytes(runner.overhead_bytes()));
  if (s.peak_bytes > 0) fmt::print(", the largest task {} ({})", FormatBytes(s.peak_bytes), s.peak_task);
  fmt::print("\ndisk        about {} to write, {} free\n", FormatBytes(s.disk_bytes),
             FormatBytes(scheduling::FreeDiskBytes(dir)));
  fmt::print("time        about {} with {} threads ({} of one core)\n", FormatDuration(s.time_s),
             runner.limits().threads, FormatDuration(s.work_s));
}

/// Says what a run would do, and refuses what orient would refuse.
int RunPlan(const OrientFlags& flags, ProgramContext& context) {
  scheduling::OrientOptions options = OptionsOf(flags);
  PlanRunner runner(flags.run, context);
  const auto workspace =
      scheduling::Workspace::ForPlanning(flags.workspace.empty() ? "rilievo-workspace" : flags.workspace);
  Inputs inputs = LoadUsableInputs(flags, runner, context);
  const scheduling::OrientRun run = PlannedRun(flags, options, inputs, workspace, runner, context);
  const auto summary = scheduling::Summarize(run, runner.limits().budget_bytes, runner.limits().threads);
  PrintPlan(summary, flags, inputs, runner, workspace.dir());
  scheduling::RefuseWhatCannotFit(summary, runner.limits().budget_bytes, runner.overhead_bytes(), workspace.dir());
  return kExitDone;
}

CLI::App* AddInputCommand(CLI::App& app, const std::string& name, const std::string& description, OrientFlags& flags) {
  CLI::App* command = app.add_subcommand(name, description);
  AddInputFlags(*command, flags.inputs);
  AddPairFlags(*command, flags.pairs);
  command
      ->add_option(
          "--until", flags.until,
          "Where to stop: pairs = features and relative orientations only; the same command without it goes on")
      ->check(CLI::IsMember({"pairs", "orientation"}))
      ->capture_default_str();
  command
      ->add_option("--strip-width", flags.strip_width_px,
                   "Width of the strips that features are detected in, two at a time [px]; 0 = as wide as the memory "
                   "allows. Never changes a result")
      ->check(CLI::Range(0, 65536))
      ->capture_default_str()
      ->type_name("PX")
      ->group("Run");
  AddOptionsFile(*command, flags.options_file);
  AddStageOptions(*command, flags.options);
  return command;
}

}  // namespace

void AddOrientCommand(CLI::App& app, ProgramContext& context) {
  auto flags = std::make_shared<OrientFlags>();
  CLI::App* command = AddInputCommand(
      app, "orient", "Orient a block of photographs: exterior orientation, object points, report", *flags);
  command
      ->add_option("--workspace", flags->workspace,
                   "Folder for all results; made when it is not there; running again continues in it")
      ->type_name("DIR")
      ->required();
  AddRunFlags(*command, flags->run);
  command->footer(
      "Examples:\n  rilievo orient photos/ --calibration camera.toml --workspace block/ --memory 4GiB\n"
      "  rilievo orient photos/ --calibration camera.toml --workspace block/ --network guided --until pairs");
  command->callback([flags, command, &context] {
    ApplyOptionsFile(*command, flags->options_file);
    context.exit_code = RunOrient(*flags, context);
  });
}

void AddPlanCommand(CLI::App& app, ProgramContext& context) {
  auto flags = std::make_shared<OrientFlags>();
  CLI::App* command =
      AddInputCommand(app, "plan", "Say what orient would do: pairs, tasks, peak memory, disk space, time", *flags);
  command->add_option("--workspace", flags->workspace, "Folder that may hold a part already")->type_name("DIR");
  AddLimitFlags(*command, flags->run);
  command->footer("Example:\n  rilievo plan photos/ --calibration camera.toml --memory 2GiB");
  command->callback([flags, command, &context] {
    ApplyOptionsFile(*command, flags->options_file);
    context.exit_code = RunPlan(*flags, context);
  });
}

}  // namespace rilievo::app
