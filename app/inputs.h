// What a run works on: images of a folder or of a scene, with their cameras.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "app/run_flags.h"
#include "block/block.h"
#include "block/pixels.h"
#include "scheduling/orient_options.h"

namespace rilievo::app {

struct InputFlags {
  std::string images;
  std::vector<std::string> calibrations;
  std::string pixel_origin = "corner";
  std::string order;
  std::string masks;  ///< folder, empty = none
};

struct Inputs {
  std::filesystem::path images;  ///< absolute
  bool from_scene = false;
  Block block;
  std::unique_ptr<PixelSource> pixels;
  std::unique_ptr<PixelSource> masks;  ///< of the images that have one; null without --masks
  std::vector<std::string> warnings;
};

void AddInputFlags(CLI::App& command, InputFlags& flags);
void AddStageOptions(CLI::App& command, scheduling::OrientOptions& options);

/// Reads the list, headers and content digests of the images (in parallel, through `runner`) and gives each its camera
/// and mask. Throws Error when nothing can be oriented with what is there (no readable image, calibration or mask that
/// does not fit).
Inputs LoadInputs(const InputFlags& flags, PlanRunner& runner);

}  // namespace rilievo::app
