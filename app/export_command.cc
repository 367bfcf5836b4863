// rilievo export: the orientation in the formats of other programs.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <span>

#include "app/command.h"
#include "app/stored_run.h"
#include "block/io/bundler.h"
#include "block/io/colmap.h"
#include "block/io/ply.h"
#include "engine/artifact_store.h"

namespace rilievo::app {
namespace {

namespace fs = std::filesystem;

struct ExportFlags {
  std::string workspace, format, output;
};

io::FileSet Convert(const std::string& format, const Block& block, const Model& model) {
  if (format == "colmap-text") return io::ColmapText(block, model);
  if (format == "colmap-binary") return io::ColmapBinary(block, model);
  if (format == "bundler") return io::BundlerText(block, model);
  return io::Ply(block, model, io::PlyForm::kBinary);
}

void WriteAll(const fs::path& dir, const io::FileSet& files) {
  std::error_code failed;
  fs::create_directories(dir, failed);
  if (failed)
    throw Error(ErrorCode::kIo, dir.string(), "cannot be made: " + failed.message(),
                "give an --output you may write to");
  for (const auto& [name, content] : files) engine::WriteFileDurably(dir / name, std::as_bytes(std::span(content)));
}

int RunExport(const ExportFlags& flags) {
  const StoredRun run = OpenRun(flags.workspace);
  const OrientationResult result = RequireOrientation(run);
  if (result.models.empty())
    throw Error(ErrorCode::kInvalidInput, flags.workspace, "no image was oriented: there is nothing to export",
                "see report.txt there");
  for (std::size_t m = 0; m < result.models.size(); ++m) {
    const fs::path dir =
        result.models.size() == 1 ? fs::path(flags.output) : fs::path(flags.output) / std::to_string(m);
    WriteAll(dir, Convert(flags.format, run.record.block, result.models[m]));
    fmt::print("{}: {} images, {} points\n", dir.string(), result.models[m].cam_from_world.size(),
               result.models[m].points.size());
  }
  return kExitDone;
}

}  // namespace

void AddExportCommand(CLI::App& app, ProgramContext& context) {
  auto flags = std::make_shared<ExportFlags>();
  CLI::App* command = app.add_subcommand(
      "export", "Write the orientation for other programs; several components go to OUT/0, OUT/1, ...");
  command->add_option("workspace", flags->workspace, "Workspace folder")->required()->type_name("DIR");
  command->add_option("--format", flags->format, "Format")
      ->required()
      ->check(CLI::IsMember({"colmap-text", "colmap-binary", "bundler", "ply"}));
  command->add_option("--output", flags->output, "Folder to write to; made when it is not there")
      ->required()
      ->type_name("OUT");
  command->footer("Example:\n  rilievo export block/ --format colmap-text --output colmap/");
  command->callback([flags, &context] { context.exit_code = RunExport(*flags); });
}

}  // namespace rilievo::app
