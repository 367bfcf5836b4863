// Writes a scene to disk: photographs with EXIF, calibration, and the truth beside them.
#pragma once

#include <filesystem>
#include <vector>

#include "base/run_context.h"
#include "simulation/renderer.h"

namespace rilievo::simulation {

struct WriteOptions {
  bool depth = false;  ///< ground-truth depth of each image as PFM (4 bytes a pixel)
  bool surface = true;
  int points = 4000;  ///< exact object points
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

/// scene.json, calibration.toml, truth/{poses.txt, cameras.txt, points.txt, surface.ply}: all but the images. Creates
/// the folders. Throws Error(kIo).
void WriteSceneData(const Renderer& renderer, const std::filesystem::path& folder, const WriteOptions& options);
/// images/NAME and, if asked for, truth/depth/NAME.pfm of one image. Creates the folders; each file appears complete or
/// not at all. Throws Error(kIo).
void WriteSceneImage(const Renderer& renderer, std::size_t image, const std::filesystem::path& folder,
                     const WriteOptions& options);
/// All of it, the images through context.ParallelFor.
void WriteScene(const Scene& scene, const std::filesystem::path& folder, const WriteOptions& options,
                RunContext& context);

}  // namespace rilievo::simulation
