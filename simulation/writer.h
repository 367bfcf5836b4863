// Writes a scene to disk: photographs with EXIF, calibration, and the truth beside them.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "simulation/renderer.h"

namespace rilievo::simulation {

struct WriteOptions {
  bool depth = false;  ///< ground-truth depth of each image as PFM (4 bytes a pixel)
  int points = 4000;   ///< exact object points
  int jpeg_quality = 97;
};

/// An exact object point and its exact projections into all images that see it.
struct TruePoint {
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  struct Projection {
    std::size_t image = 0;
    Eigen::Vector2d pixel_px = Eigen::Vector2d::Zero();
  };
  std::vector<Projection> projections;  ///< by image, at least one
};

/// `count` points of the surface, each drawn at a random pixel of an image, the images in turn. Deterministic. Fewer
/// when images show little of the object.
std::vector<TruePoint> MakeTruePoints(const Renderer& renderer, int count);

/// Where the files of a block are.
std::filesystem::path ImagePath(const std::filesystem::path& folder, const std::string& name);
std::filesystem::path DepthPath(const std::filesystem::path& folder, const std::string& name);
std::filesystem::path CalibrationPath(const std::filesystem::path& folder);
/// What WriteSceneData writes.
std::vector<std::filesystem::path> SceneDataPaths(const std::filesystem::path& folder);

/// The camera as this project's calibration file.
std::string CalibrationToml(const Camera& camera);

// Writing creates the folders; each file appears complete or not at all. Throws Error(kIo, kDiskFull).

/// calibration.toml, truth/{poses.txt, cameras.txt, points.txt, surface.ply}: all but the images and scene.json.
void WriteSceneData(const Renderer& renderer, const std::filesystem::path& folder, const WriteOptions& options);
/// images/NAME of one image.
void WriteSceneImage(const Renderer& renderer, std::size_t image, const std::filesystem::path& folder,
                     const WriteOptions& options);
/// truth/depth/NAME.pfm of one image.
void WriteSceneDepth(const Renderer& renderer, std::size_t image, const std::filesystem::path& folder);
/// The image and, if asked for, its depth, each unless it is there already.
void WriteMissing(const Renderer& renderer, std::size_t image, const std::filesystem::path& folder,
                  const WriteOptions& options);

}  // namespace rilievo::simulation
