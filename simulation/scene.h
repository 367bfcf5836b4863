// A synthetic block: the object, the cameras and everything else that fixes every pixel of every image.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "base/option.h"
#include "block/camera.h"
#include "geometry/rigid3.h"

namespace rilievo::simulation {

struct SceneOptions {
  std::string surface = "relief";  ///< relief | sphere | statue
  std::string network = "arc";     ///< arc | strip | ring | random
  int images = 12;
  int width_px = 4000, height_px = 3000;
  double focal_px = 0;  ///< 0 = 1.1 * width
  double distance_m = 4;
  double object_size_m = 2.0;
  double angle_step_deg = 0;  ///< intersection angle of neighbouring images; 0 = the network's own
  int strips = 1;             ///< rows of a strip network
  double noise = 0.005;       ///< standard deviation as a fraction of the full range
  double blur_px = 0.5;       ///< sigma of the Gaussian point spread function
  double vignetting = 0.15;   ///< loss of light in the corners as a fraction
  double exposure_spread = 0.05;
  bool distortion = true;
  std::string bits = "8";      ///< a pixel: 8 | 16
  std::string format = "jpg";  ///< jpg | png | tif
  int surface_points = 500000;
  int seed = 1;
};

std::span<const OptionDeclaration<SceneOptions>> SceneOptionDeclarations();

/// World frame in metres: y up, z towards the cameras of a relief (its plane is z = 0); closed objects stand on the
/// origin's place, axis y. `cam_from_world` is exact. All images share `camera`.
struct Scene {
  SceneOptions options;
  Camera camera;
  std::vector<std::string> names;      ///< file names with ending, in sequence order
  std::vector<Rigid3> cam_from_world;  ///< one an image
  std::vector<double> exposures;       ///< factor on the light of each image
  /// Part of the plane z = 0 that a relief covers: x from/to, y from/to. Zero for closed objects.
  Eigen::Vector4d panel_m = Eigen::Vector4d::Zero();
};

/// Bumped whenever an equal scene renders to other pixels: part of scene files and of image digests.
inline constexpr int kRendererVersion = 2;

/// Lays out the block that the options describe; pure and deterministic. Throws Error(kUsage) for options out of range
/// or in contradiction.
Scene MakeScene(const SceneOptions& options);

/// What is allowed and yet hardly orientable, one line each: neighbours of a closed object's ring too far apart.
std::vector<std::string> SceneWarnings(const SceneOptions& options);

/// The scene as the text of its file (docs/formats/scene.md).
std::string SceneText(const Scene& scene);
/// Reads SceneText back; equal to the scene written, bit by bit. `path` is named in errors. Throws Error.
Scene ParseScene(const std::string& text, const std::string& path);

/// The file appears complete or not at all. Throws Error(kIo, kDiskFull).
void WriteSceneFile(const Scene& scene, const std::filesystem::path& path);
/// Throws Error(kNotFound, kUnreadable, kInvalidInput, kVersion).
Scene ReadSceneFile(const std::filesystem::path& path);
/// True for a regular file that says it is a scene in its first bytes; never throws.
bool IsSceneFile(const std::filesystem::path& path);

}  // namespace rilievo::simulation
