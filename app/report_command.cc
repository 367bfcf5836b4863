// rilievo report: the orientation result as text or JSON; with --truth the errors against a simulated scene.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "app/command.h"
#include "app/stored_run.h"
#include "app/truth_report.h"
#include "stages/reporting/orientation_report.h"

namespace rilievo::app {
namespace {

struct ReportFlags {
  std::string workspace, truth;
  bool json = false;
};

int RunReport(const ReportFlags& flags, const ProgramContext& context) {
  const StoredRun run = OpenRun(flags.workspace);
  const OrientationResult result = RequireOrientation(run);
  const Block& block = run.record.block;
  const reporting::Report report = reporting::Summarize(block, result);
  if (flags.json) {
    nlohmann::json out = reporting::ToJson(report, block, result, run.record.warnings);
    if (!flags.truth.empty()) out["truth"] = TruthJson(flags.truth, run.record, result, context);
    fmt::print("{}\n", out.dump(1));
  } else {
    fmt::print("{}", reporting::ToText(report, block, result, run.record.warnings));
    if (!flags.truth.empty()) fmt::print("{}", TruthText(flags.truth, run.record, result, context));
  }
  return kExitDone;
}

}  // namespace

void AddReportCommand(CLI::App& app, ProgramContext& context) {
  auto flags = std::make_shared<ReportFlags>();
  CLI::App* command =
      app.add_subcommand("report", "Orientation result: images, points, rays, residuals, per image and in all");
  command->add_option("workspace", flags->workspace, "Workspace folder")->required()->type_name("DIR");
  command->add_flag("--json", flags->json, "JSON for programs (docs/formats/report.md)");
  command
      ->add_option("--truth", flags->truth,
                   "Scene file of rilievo simulate: also print the errors against its exact truth")
      ->type_name("FILE");
  command->footer("Example:\n  rilievo report block/ --json");
  command->callback([flags, &context] { context.exit_code = RunReport(*flags, context); });
}

}  // namespace rilievo::app
