// A model while it grows: poses of its images, object points of the tracks, and which rays are in use.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "base/serialize.h"
#include "geometry/rigid3.h"
#include "geometry/triangulation.h"
#include "stages/mapping/tie_block.h"

namespace rilievo::mapping {

/// What a ray and a point must satisfy to be used.
struct PointTolerance {
  double max_residual_px = 4.0;
  double min_angle_rad = 0.026;
};

/// Refers to a TieBlock that must outlive it. Copyable: attempts are compared and the best is kept.
class Reconstruction {
 public:
  Reconstruction(const TieBlock& ties, std::uint64_t seed);

  const TieBlock& ties() const { return *ties_; }

  // Images.
  bool IsRegistered(ImageId image) const { return poses_[image.value].has_value(); }
  const Rigid3& cam_from_world(ImageId image) const { return poses_[image.value]->rigid; }
  const CameraPose& camera_pose(ImageId image) const { return poses_[image.value]->camera; }
  std::vector<ImageId> RegisteredImages() const;  ///< ascending
  std::size_t NumRegistered() const { return registered_; }
  void SetPose(ImageId image, const Rigid3& cam_from_world);
  /// Takes the image and its rays out; points left with one ray go too.
  void RemoveImage(ImageId image);

  // Points.
  bool HasPoint(std::uint32_t track) const { return has_point_[track] != 0; }
  const Eigen::Vector3d& position(std::uint32_t track) const { return positions_[track]; }
  void SetPosition(std::uint32_t track, const Eigen::Vector3d& position) { positions_[track] = position; }
  bool IsUsed(std::uint32_t ray) const { return used_[ray] != 0; }
  std::size_t NumPoints() const { return points_; }
  int NumUsedRays(std::uint32_t track) const;
  std::vector<std::uint32_t> Tracks() const;  ///< tracks with a point, ascending
  /// Rays of the image whose track has a point, whether in use or not.
  std::uint32_t NumVisible(ImageId image) const { return visible_[image.value]; }
  /// Rays of the image in use.
  std::uint32_t NumUsed(ImageId image) const;
  std::vector<RayView> UsedViews(std::uint32_t track) const;
  void RemovePoint(std::uint32_t track);

  /// Forward intersection of a track without point from its registered rays; a track with a point takes in the
  /// registered rays that fit it. Returns the number of rays newly in use.
  int Intersect(std::uint32_t track, const PointTolerance& tolerance);
  /// Gauss-Newton of the point on its rays in use.
  void Refine(std::uint32_t track);
  /// Drops rays above the residual and points under the angle. Returns the number of rays dropped.
  int Filter(std::uint32_t track, const PointTolerance& tolerance);

  /// Every bit of poses, points and rays in use.
  void Write(ByteWriter& out) const;
  /// What Write wrote, on the same ties. Throws Error(kInvalidInput) when it does not fit them.
  static Reconstruction Read(ByteReader& in, const TieBlock& ties, std::uint64_t seed);

 private:
  struct Pose {
    Rigid3 rigid;
    CameraPose camera;
  };
  RayView View(std::uint32_t ray) const;

  const TieBlock* ties_;
  std::uint64_t seed_;
  std::size_t registered_ = 0, points_ = 0;
  std::vector<std::optional<Pose>> poses_;
  std::vector<Eigen::Vector3d> positions_;  // per track
  std::vector<std::uint8_t> has_point_;     // per track
  std::vector<std::uint8_t> used_;          // per ray
  std::vector<std::uint32_t> visible_;      // per image
};

}  // namespace rilievo::mapping
