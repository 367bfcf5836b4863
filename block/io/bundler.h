// Bundler's file format v0.3 (docs/formats/exports.md).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "block/block.h"
#include "block/features.h"
#include "block/io/file_set.h"
#include "block/model.h"

namespace rilievo::io {

/// bundle.out and list.txt. All images in block order; those without orientation have zeros for a camera. Bundler knows
/// one focal length, k1 and k2 about a principal point in the image's middle. A camera of just that form is written as
/// it is. Any other camera becomes the ideal one with f = fx and without distortion, and its measurements are carried
/// over: undistorted, recentred, scaled. Poses, points and image rays are unchanged; the files then fit images that
/// were undistorted in this way. Measurements where the distortion cannot be inverted are left out. Keys are feature
/// numbers.
FileSet BundlerText(const Block& block, const Model& model);

struct BundlerScene {
  struct Camera {
    double focal_px = 0, k1 = 0, k2 = 0;  ///< focal_px = 0: not oriented
    Rigid3 cam_from_world;                ///< in this project's camera axes (x right, y down, z forward)
  };
  struct Measurement {
    std::uint32_t camera = 0, key = 0;
    Eigen::Vector2d centered_px = Eigen::Vector2d::Zero();  ///< from the image's middle, x right, y down
  };
  struct Point {
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    Rgb color{};
    std::vector<Measurement> measurements;
  };
  std::vector<Camera> cameras;
  std::vector<Point> points;
};

/// Reads the text of a bundle file; `name` serves messages. Throws Error for damaged content.
BundlerScene ReadBundler(const std::string& name, const std::string& content);

}  // namespace rilievo::io
