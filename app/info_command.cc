// rilievo info: the state of a workspace, per stage and image.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <vector>

#include "app/command.h"
#include "app/stored_run.h"
#include "scheduling/orient_plan.h"

namespace rilievo::app {
namespace {

void PrintInfo(const StoredRun& run) {
  const engine::ArtifactStore& store = run.workspace.store();
  const auto result = scheduling::LoadOrientation(store, run.keys);
  const auto count = [&](const std::vector<engine::ArtifactKey>& keys) {
    std::size_t done = 0;
    for (const auto& key : keys) done += store.Exists(key) ? 1 : 0;
    return done;
  };
  fmt::print("workspace    {}\n", run.workspace.dir().string());
  fmt::print("images       {}{}\n", run.record.images.string(),
             std::filesystem::exists(run.record.images)
                 ? ""
                 : " (not there any more: report and export work, orient needs the new place)");
  fmt::print("network      {}\n", scheduling::NetworkName(run.record.options.network));
  fmt::print("features     {} of {} images\n", count(run.keys.features), run.keys.features.size());
  fmt::print("pairs        {} of {} tiles{}\n", count(run.keys.pairs), run.keys.pairs.size(),
             run.keys.tiles_complete ? "" : " known so far");
  fmt::print("orientation  {}\n", result ? "done" : "not finished: run the same orient command again");
  for (const auto& warning : run.record.warnings) fmt::print("WARNING      {}\n", warning);

  std::vector<std::string> states(run.record.block.images.size());
  if (result) {
    for (std::size_t m = 0; m < result->models.size(); ++m)
      for (const auto& [id, pose] : result->models[m].cam_from_world)
        states.at(id.value) = result->models.size() == 1 ? "oriented" : fmt::format("oriented, component {}", m + 1);
    for (const auto& u : result->unoriented) states.at(u.image.value) = "not oriented: " + u.reason;
    for (std::size_t i = 0; i < states.size(); ++i)
      if (!result->images.at(i).quarantine.empty()) states[i] = "quarantined: " + result->images[i].quarantine;
  }
  fmt::print("\n   width  height  features  image\n");
  for (const Image& image : run.record.block.images) {
    const bool there = store.Exists(run.keys.features[image.id.value]);
    const std::string features = result  ? std::to_string(result->images.at(image.id.value).features)
                                 : there ? "done"
                                         : "-";
    fmt::print("  {:6}  {:6}  {:>8}  {}{}\n", image.width_px, image.height_px, features, image.name,
               states[image.id.value].empty() ? "" : ": " + states[image.id.value]);
  }
  for (const auto& q : run.record.block.quarantined)
    fmt::print("       -       -         -  {}: quarantined: {}\n", q.name, q.reason);
}

}  // namespace

void AddInfoCommand(CLI::App& app, ProgramContext& context) {
  auto dir = std::make_shared<std::string>();
  CLI::App* command = app.add_subcommand("info", "State of a workspace, per stage and image");
  command->add_option("workspace", *dir, "Workspace folder")->required()->type_name("DIR");
  command->footer("Example:\n  rilievo info block/");
  command->callback([dir, &context] {
    PrintInfo(OpenRun(*dir));
    context.exit_code = kExitDone;
  });
}

}  // namespace rilievo::app
