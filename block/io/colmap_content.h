// The records of a COLMAP model, common to text and binary.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "block/io/colmap.h"

namespace rilievo::io {

inline constexpr std::uint64_t kNoColmapPoint = std::numeric_limits<std::uint64_t>::max();

struct ColmapContent {
  struct CameraRecord {
    std::uint32_t id = 0;
    std::uint64_t width_px = 0, height_px = 0;
    CameraModel model;
  };
  struct Point2 {
    Eigen::Vector2d position_px = Eigen::Vector2d::Zero();
    std::uint64_t point_id = kNoColmapPoint;
  };
  struct ImageRecord {
    std::uint32_t id = 0, camera_id = 0;
    Rigid3 cam_from_world;
    std::string name;
    std::vector<Point2> points;
  };
  struct Point3 {
    std::uint64_t id = 0;
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    Rgb color{};
    double error_px = 0;
    std::vector<std::pair<std::uint32_t, std::uint32_t>> track;  ///< image id, index of the 2D point
  };
  std::vector<CameraRecord> cameras;
  std::vector<ImageRecord> images;
  std::vector<Point3> points;
};

ColmapContent ContentOf(const Block& block, const Model& model);
ColmapModel ModelOf(ColmapContent content);

/// qw qx qy qz tx ty tz; a unit quaternion is kept to the bit, another one is normalised. Throws Error for a zero
/// quaternion.
Rigid3 PoseFromNumbers(const std::array<double, 7>& numbers);

ColmapContent ParseColmapText(const FileSet& files);
ColmapContent ParseColmapBinary(const FileSet& files);

}  // namespace rilievo::io
