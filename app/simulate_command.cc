// rilievo simulate: a block of photographs with exact truth.
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <vector>

#include "app/command.h"
#include "app/declared_options.h"
#include "app/run_flags.h"
#include "base/units.h"
#include "scheduling/workspace.h"
#include "simulation/block_folder.h"
#include "simulation/renderer.h"
#include "simulation/scene.h"
#include "simulation/writer.h"

namespace rilievo::app {
namespace {

namespace fs = std::filesystem;

struct SimulateFlags {
  simulation::SceneOptions scene;
  RunFlags run;
  std::string output, options_file;
  bool depth = false, scene_only = false;
};

/// JPEG of quality 97 of a textured image takes up to a byte and a half a pixel; PNG and TIFF as much as their samples.
std::uint64_t DiskBytes(const SimulateFlags& flags, std::size_t images) {
  const auto& o = flags.scene;
  const double sample_bytes = o.format == "jpg" ? 1.5 : (o.bits == "16" ? 2.2 : 1.1);
  const double pixels = static_cast<double>(o.width_px) * o.height_px;
  return static_cast<std::uint64_t>(static_cast<double>(images) * pixels * (sample_bytes + (flags.depth ? 4 : 0))) +
         64 * kMebibyte;
}

/// Every missing image, and what describes the block when all of them are there: whoever finds scene.json finds a whole
/// block.
engine::Plan MakeSimulatePlan(const simulation::Renderer& renderer, simulation::BlockFolder& folder,
                              const SimulateFlags& flags, std::uint64_t image_bytes) {
  const auto& options = flags.scene;
  const simulation::WriteOptions write{.depth = flags.depth};
  engine::Plan plan;
  std::vector<TaskId> images;
  for (const std::size_t i : folder.missing_images())
    images.push_back(plan.Add({.name = "render " + renderer.scene().names[i],
                               .stage = "render",
                               .needs = {},
                               .cost = {image_bytes, 3e-7 * options.width_px * options.height_px},
                               .memory_hint = "raise --memory",
                               .run = [&renderer, &flags, write, i](engine::TaskContext&) {
                                 simulation::WriteMissing(renderer, i, flags.output, write);
                               }}));
  plan.Add({.name = "truth",
            .stage = "truth",
            .needs = std::move(images),
            .cost = {64 * kMebibyte, 2},
            .memory_hint = "raise --memory",
            .run = [&renderer, &flags, &folder, write](engine::TaskContext&) {
              simulation::WriteSceneData(renderer, flags.output, write);
              folder.Finish();
            }});
  return plan;
}

int WriteSceneOnly(const SimulateFlags& flags, simulation::BlockFolder& folder) {
  folder.WriteSceneOnly();
  if (!flags.run.quiet) fmt::print("scene: {}\n", (fs::path(flags.output) / "scene.json").string());
  return kExitDone;
}

int RunSimulate(const SimulateFlags& flags, ProgramContext& context) {
  const simulation::Scene scene = simulation::MakeScene(flags.scene);
  simulation::BlockFolder folder(flags.output, scene);
  if (!flags.run.quiet)
    for (const auto& warning : simulation::SceneWarnings(flags.scene)) PrintWarning(context, warning);
  if (flags.scene_only) return WriteSceneOnly(flags, folder);
  folder.Look(flags.depth);
  if (folder.finished()) {
    if (!flags.run.quiet) fmt::print("nothing to do: this block is already in {}\n", flags.output);
    return kExitDone;
  }
  const std::uint64_t disk_bytes = DiskBytes(flags, folder.missing_images().size()),
                      free_bytes = scheduling::FreeDiskBytes(flags.output);
  if (disk_bytes > free_bytes)
    throw Error(ErrorCode::kDiskFull, flags.output,
                fmt::format("the block needs about {} on this disk and {} are free", FormatBytes(disk_bytes),
                            FormatBytes(free_bytes)),
                "free some space, or give an --output on another disk");
  PlanRunner runner(flags.run, context);
  const auto bytes = simulation::EstimateRenderBytes(scene);
  runner.HoldResident(bytes.shared, "the scene's surface");
  folder.Begin();
  const simulation::Renderer renderer(scene);
  engine::Plan plan = MakeSimulatePlan(renderer, folder, flags, bytes.per_image);
  runner.Run(plan);
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
  command
      ->add_option("--output", flags->output,
                   "Folder to write to; made when it is not there; running again continues in it")
      ->required()
      ->type_name("DIR");
  command->add_flag("--depth", flags->depth, "Also write the true depth of every pixel (PFM, 4 bytes a pixel)");
  command->add_flag("--scene-only", flags->scene_only,
                    "Write scene.json alone: orient renders the images from it on demand");
  AddOptionsFile(*command, flags->options_file);
  AddDeclaredOptions(*command, flags->scene, simulation::SceneOptionDeclarations(), "Scene");
  AddRunFlags(*command, flags->run);
  command->footer("Example:\n  rilievo simulate --images 12 --width-px 4000 --height-px 3000 --output block/");
  command->callback([flags, command, &context] {
    ApplyOptionsFile(*command, flags->options_file);
    context.exit_code = RunSimulate(*flags, context);
  });
}

}  // namespace rilievo::app
