// rilievo simulate: a block of photographs with exact truth.
#include <fmt/format.h>

#include <filesystem>

#include "app/command.h"
#include "app/run_flags.h"
#include "scheduling/workspace.h"
#include "simulation/renderer.h"
#include "simulation/scene.h"
#include "simulation/writer.h"

namespace rilievo::app {
namespace {

namespace fs = std::filesystem;

struct SimulateFlags {
  simulation::SceneOptions scene;
  RunFlags run;
  std::string output;
  bool depth = false, scene_only = false;
};

/// JPEG of quality 97 of a textured image takes up to a byte and a half a pixel; PNG and TIFF as much as their samples.
std::uint64_t DiskBytes(const SimulateFlags& flags) {
  const auto& o = flags.scene;
  const double sample_bytes = o.format == "jpg" ? 1.5 : (o.bits == "16" ? 2.2 : 1.1);
  const double pixels = static_cast<double>(o.width_px) * o.height_px;
  return static_cast<std::uint64_t>(o.images * pixels * (sample_bytes + (flags.depth ? 4 : 0))) + 64 * kMebibyte;
}

int RunSimulate(const SimulateFlags& flags, ProgramContext& context) {
  ValidateOptions(flags.scene, simulation::SceneOptionDeclarations());
  const simulation::Scene scene = simulation::MakeScene(flags.scene);
  std::error_code failed;
  fs::create_directories(flags.output, failed);
  if (failed)
    throw Error(ErrorCode::kIo, flags.output, "cannot be made: " + failed.message(),
                "give an --output you may write to");
  if (flags.scene_only) {
    simulation::WriteSceneFile(scene, fs::path(flags.output) / "scene.json");
    fmt::print("scene: {}\n", (fs::path(flags.output) / "scene.json").string());
    return kExitDone;
  }
  if (const auto free_bytes = scheduling::FreeDiskBytes(flags.output); DiskBytes(flags) > free_bytes)
    throw Error(ErrorCode::kDiskFull, flags.output,
                fmt::format("the block needs about {} on this disk and {} are free", FormatBytes(DiskBytes(flags)),
                            FormatBytes(free_bytes)),
                "free some space, or give an --output on another disk");
  PlanRunner runner(flags.run, context);
  const auto bytes = simulation::EstimateRenderBytes(scene);
  runner.HoldResident(bytes.shared, "the scene's surface");
  const simulation::Renderer renderer(scene);
  const simulation::WriteOptions write{.depth = flags.depth};
  engine::Plan plan;
  plan.Add({.name = "truth",
            .stage = "truth",
            .needs = {},
            .cost = {64 * kMebibyte, 2},
            .memory_hint = "raise --memory",
            .run = [&](engine::TaskContext&) { simulation::WriteSceneData(renderer, flags.output, write); }});
  for (std::size_t i = 0; i < scene.names.size(); ++i)
    plan.Add({.name = "render " + scene.names[i],
              .stage = "render",
              .needs = {},
              .cost = {bytes.per_image, 3e-7 * flags.scene.width_px * flags.scene.height_px},
              .memory_hint = "raise --memory",
              .run = [&, i](engine::TaskContext&) { simulation::WriteSceneImage(renderer, i, flags.output, write); }});
  const engine::ExecutionReport report = runner.Run(plan);
  for (const auto& outcome : report.outcomes)
    if (outcome.state == engine::TaskState::kFailed) throw Error(ErrorCode::kIo, "", outcome.error);
  if (!flags.run.quiet)
    fmt::print("{} images of {} x {} px, calibration.toml, scene.json and truth in {}\n", scene.names.size(),
               flags.scene.width_px, flags.scene.height_px, flags.output);
  return kExitDone;
}

}  // namespace

void AddSimulateCommand(CLI::App& app, ProgramContext& context) {
  auto flags = std::make_shared<SimulateFlags>();
  CLI::App* command =
      app.add_subcommand("simulate", "Render a block of photographs with exact truth: poses, points, depth, surface");
  command->add_option("--output", flags->output, "Folder to write to; made when it is not there")
      ->required()
      ->type_name("DIR");
  command->add_flag("--depth", flags->depth, "Also write the true depth of every pixel (PFM, 4 bytes a pixel)");
  command->add_flag("--scene-only", flags->scene_only,
                    "Write scene.json alone: orient renders the images from it on demand");
  AddDeclaredOptions(*command, flags->scene, simulation::SceneOptionDeclarations(), "Scene");
  AddRunFlags(*command, flags->run);
  command->footer("Example:\n  rilievo simulate --images 12 --width-px 4000 --height-px 3000 --output block/");
  command->callback([flags, &context] { context.exit_code = RunSimulate(*flags, context); });
}

}  // namespace rilievo::app
