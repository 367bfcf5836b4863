// The folder that a simulated block is written to: whose it is, what is there already, what is missing.
#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include "simulation/scene.h"

namespace rilievo::simulation {

/// A folder holds one scene. While it is unfinished the scene's text is in `scene.json.partial`; `scene.json` takes its
/// place when every other file is there. Files appear complete or not at all, so whatever is there is kept and a
/// stopped simulation continues where it was.
class BlockFolder {
 public:
  /// Looks only. Throws Error(kInvalidInput), saying why and what to do, when `dir` is a file, holds another scene, or
  /// is neither empty nor a block's; when `images` holds files that are not of this scene, or calibration.toml is not
  /// this scene's: nothing of the user's is overwritten, and no foreign image gets into an orientation.
  BlockFolder(std::filesystem::path dir, const Scene& scene);

  bool finished() const { return has_scene_ && missing_images_.empty() && !missing_data_; }
  /// Images whose file, or asked-for depth, is not there yet, ascending. `depth` as given to Look.
  const std::vector<std::size_t>& missing_images() const { return missing_images_; }
  /// Finds out what is missing; the constructor does it without depth.
  void Look(bool depth);

  /// Makes the folder and the marker of an unfinished block; removes what killed programs left half written.
  /// Throws Error(kIo).
  void Begin();
  /// The block is complete: scene.json takes the marker's place. Throws Error(kIo).
  void Finish();
  /// Writes scene.json alone into a folder that holds no images: they are rendered from it on demand. Throws Error.
  void WriteSceneOnly();

 private:
  void RefuseForeignScene() const;
  void RefuseForeignFiles() const;

  std::filesystem::path dir_;
  const Scene& scene_;
  bool has_scene_ = false, has_marker_ = false, missing_data_ = true;
  std::vector<std::size_t> missing_images_;
};

}  // namespace rilievo::simulation
