// Lists, inspects and calibrates the images of a run.
#include "app/inputs.h"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "app/declared_options.h"
#include "base/units.h"
#include "block/io/assign_cameras.h"
#include "block/io/calibration.h"
#include "block/io/duplicate_images.h"
#include "block/io/image_folder.h"
#include "block/io/image_header.h"
#include "simulation/renderer.h"
#include "simulation/scene.h"
#include "simulation/scene_source.h"
#include "stages/images/decode.h"
#include "stages/images/masks.h"

namespace rilievo::app {
namespace {

namespace fs = std::filesystem;

/// Reads all headers and digests in parallel; a file that cannot be read goes to `quarantined`.
std::vector<Image> InspectImages(const fs::path& folder, const std::vector<std::string>& names, PlanRunner& runner,
                                 std::vector<QuarantinedImage>& quarantined) {
  std::vector<std::optional<Image>> found(names.size());
  std::vector<std::string> reasons(names.size());
  engine::Plan plan;
  for (std::size_t i = 0; i < names.size(); ++i) {
    plan.Add({.name = "inspect " + names[i],
              .stage = "inspect",
              .needs = {},
              .cost = {4 * kMebibyte, 0.01},
              .memory_hint = "raise --memory",
              .run = [&, i](engine::TaskContext&) {
                try {
                  found[i] = io::ReadImageHeader(folder, names[i]);
                } catch (const Error& error) {
                  reasons[i] = error.message();
                }
              }});
  }
  runner.RunQuietly(plan);
  std::vector<Image> images;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (!found[i]) {
      quarantined.push_back({names[i], reasons[i].empty() ? "its header could not be read" : reasons[i]});
      continue;
    }
    found[i]->id = ImageId(static_cast<std::uint32_t>(images.size()));
    images.push_back(std::move(*found[i]));
  }
  return images;
}

std::vector<io::CalibrationEntry> ReadCalibrations(const InputFlags& flags) {
  std::vector<io::CalibrationEntry> entries;
  const auto origin = flags.pixel_origin == "center" ? io::PixelOrigin::kCenter : io::PixelOrigin::kCorner;
  for (const std::string& path : flags.calibrations)
    for (auto& entry : io::ReadCalibration(path, origin)) entries.push_back(std::move(entry));
  return entries;
}

/// Masks that lie below the image folder are no photographs.
void LeaveOutMasks(const fs::path& folder, const std::string& masks, io::FoundImages& found) {
  const std::string below = fs::weakly_canonical(fs::absolute(masks)).lexically_relative(folder).generic_string();
  if (below == ".")
    throw Error(ErrorCode::kUsage, "--masks", "is the folder of the images",
                "put the masks into a folder of their own");
  if (below.empty() || below.starts_with("..")) return;
  std::erase_if(found.names, [&](const std::string& name) { return name.starts_with(below + "/"); });
  std::erase_if(found.ignored, [&](const auto& ignored) { return ignored.name.starts_with(below + "/"); });
}

/// Reads the headers and digests of the masks in parallel; the first that does not fit its image is the Error.
void InspectMasks(const fs::path& folder, const std::vector<std::optional<std::string>>& names, Block& block,
                  PlanRunner& runner) {
  std::vector<std::optional<Error>> errors(names.size());
  engine::Plan plan;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (!names[i]) continue;
    plan.Add({.name = "mask of " + block.images[i].name,
              .stage = "inspect",
              .needs = {},
              .cost = {4 * kMebibyte, 0.01},
              .memory_hint = "raise --memory",
              .run = [&, i](engine::TaskContext&) {
                try {
                  block.images[i].mask = images::InspectMask(folder, *names[i], block.images[i]);
                } catch (const Error& error) {
                  errors[i] = error;
                }
              }});
  }
  runner.RunQuietly(plan);
  for (const auto& error : errors)
    if (error) throw *error;
}

/// Gives each image its mask, and says how many have none.
void AssignMasks(const InputFlags& flags, Inputs& inputs, PlanRunner& runner) {
  if (flags.masks.empty()) return;
  const fs::path folder = fs::weakly_canonical(fs::absolute(flags.masks));
  const images::MaskFolder masks(folder);
  std::vector<std::optional<std::string>> names;
  for (const Image& image : inputs.block.images) names.push_back(masks.Find(image.name));
  const auto missing = static_cast<std::size_t>(std::count(names.begin(), names.end(), std::nullopt));
  if (missing == names.size())
    throw Error(ErrorCode::kInvalidInput, folder.string(), "none of its files is named like an image",
                "name each mask like its image, e.g. " + inputs.block.images.front().name);
  if (missing > 0)
    inputs.warnings.push_back(std::to_string(missing) + " of " + std::to_string(names.size()) +
                              " images have no mask in " + folder.string() + " and are used whole");
  InspectMasks(folder, names, inputs.block, runner);
  inputs.masks = std::make_unique<images::FolderPixelSource>(folder);
}

Inputs LoadScene(const InputFlags& flags, PlanRunner& runner) {
  Inputs inputs;
  inputs.images = fs::weakly_canonical(fs::absolute(flags.images));
  inputs.from_scene = true;
  if (!flags.order.empty())
    throw Error(ErrorCode::kUsage, "--order", "does not go with a scene file", "a scene has its own order");
  const simulation::Scene scene = simulation::ReadSceneFile(flags.images);
  inputs.block = simulation::SceneBlock(scene);
  if (!flags.calibrations.empty()) {
    auto assigned = io::MakeBlock(inputs.block.images, {}, ReadCalibrations(flags));
    inputs.block = std::move(assigned.block);
    inputs.warnings = std::move(assigned.warnings);
  }
  AssignMasks(flags, inputs, runner);
  runner.HoldResident(simulation::EstimateRenderBytes(scene).shared, "the scene's surface");
  inputs.pixels = std::make_unique<simulation::ScenePixelSource>(std::make_shared<const simulation::Renderer>(scene));
  return inputs;
}

}  // namespace

void AddInputFlags(CLI::App& command, InputFlags& flags) {
  command
      .add_option("images", flags.images,
                  "Folder of photographs (JPEG, PNG, TIFF), or a scene file of rilievo simulate")
      ->required()
      ->type_name("IMAGES");
  command
      .add_option(
          "--calibration", flags.calibrations,
          "Interior orientation: 3x3 K matrix as text, this program's TOML, OpenCV YAML/XML or COLMAP cameras.txt; "
          "several cameras: by image size or folder, or given several times. Without it the focal length comes from "
          "EXIF")
      ->type_name("FILE")
      ->allow_extra_args(false);
  command
      .add_option("--pixel-origin", flags.pixel_origin,
                  "Where text K and cameras.txt count from: the upper-left pixel's corner (its centre is 0.5, 0.5) or "
                  "its center (0, 0)")
      ->check(CLI::IsMember({"corner", "center"}))
      ->capture_default_str();
  command
      .add_option("--order", flags.order,
                  "Text file with the order of a sequence, a name a line; else natural order of the names")
      ->type_name("FILE");
  command
      .add_option("--masks", flags.masks,
                  "Folder of 8-bit masks named like the images (a.jpg, a.jpg.png or a.png): bright (128 and more) is "
                  "used, dark ignored; images without a mask are used whole")
      ->type_name("DIR");
}

void AddStageOptions(CLI::App& command, scheduling::OrientOptions& options) {
  AddDeclaredOptions(command, options.pairs, scheduling::PairOptionDeclarations(), "Pairs");
  AddDeclaredOptions(command, options.features, features::OptionDeclarations(), "Features");
  AddDeclaredOptions(command, options.matching, matching::OptionDeclarations(), "Matching");
  AddDeclaredOptions(command, options.verification, verification::OptionDeclarations(), "Verification");
  AddDeclaredOptions(command, options.tracks, tracks::OptionDeclarations(), "Tie points");
  AddDeclaredOptions(command, options.mapping, mapping::OptionDeclarations(), "Mapping");
}

Inputs LoadInputs(const InputFlags& flags, PlanRunner& runner) {
  if (flags.images.empty()) throw Error(ErrorCode::kUsage, "IMAGES", "is empty", "give a folder of photographs");
  if (fs::is_regular_file(flags.images) && simulation::IsSceneFile(flags.images)) return LoadScene(flags, runner);
  Inputs inputs;
  inputs.images = fs::weakly_canonical(fs::absolute(flags.images));
  const std::vector<io::CalibrationEntry> calibration = ReadCalibrations(flags);
  io::FoundImages found = io::FindImages(inputs.images);
  if (!flags.masks.empty()) LeaveOutMasks(inputs.images, flags.masks, found);
  std::vector<QuarantinedImage> quarantined = std::move(found.ignored);
  if (!flags.order.empty()) {
    const std::vector<std::string> order = io::ReadOrderFile(flags.order, found.names);
    for (auto& left_out : io::LeftOutByOrder(found.names, order)) quarantined.push_back(std::move(left_out));
    found.names = order;
  }
  std::vector<Image> images = InspectImages(inputs.images, found.names, runner, quarantined);
  io::QuarantineDuplicates(images, quarantined);
  if (images.empty()) {
    const std::string example =
        quarantined.empty() ? "" : "first: " + quarantined.front().name + ": " + quarantined.front().reason;
    throw Error(ErrorCode::kInvalidInput, inputs.images.string(), "has no readable image", example);
  }
  auto assigned = io::MakeBlock(std::move(images), std::move(quarantined), calibration);
  inputs.block = std::move(assigned.block);
  inputs.warnings = std::move(assigned.warnings);
  inputs.pixels = std::make_unique<images::FolderPixelSource>(inputs.images);
  AssignMasks(flags, inputs, runner);
  return inputs;
}

}  // namespace rilievo::app
