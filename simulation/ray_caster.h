// Rays against a triangle mesh (Embree 3), and the mesh's nearest point.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>

#include "simulation/surface.h"

namespace rilievo::simulation {

inline constexpr int kPacket = 16;

/// Sixteen rays origin + t * direction with one origin. After Cast: t (infinity where nothing is hit), the triangle and
/// the barycentric coordinates u, v of its second and third corner.
struct RayPacket {
  std::array<float, kPacket> dx, dy, dz, t, u, v;
  std::array<std::uint32_t, kPacket> triangle;
};

/// Where a single ray meets the mesh: `t` and the point are in double precision from the triangle's plane.
struct RayHit {
  double t = 0;
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  std::uint32_t triangle = 0;
};

/// All calls are thread safe and deterministic; building uses one thread.
class RayCaster {
 public:
  /// Keeps a reference to the surface's vertices and triangles: it must outlive the caster. Cost about 1 us a triangle.
  explicit RayCaster(const Surface& surface);
  ~RayCaster();
  RayCaster(const RayCaster&) = delete;
  RayCaster& operator=(const RayCaster&) = delete;

  /// Nearest hits of a packet of coherent rays; about 0.1 us a ray.
  void Cast(const Eigen::Vector3f& origin, RayPacket& packet) const;
  /// Nearest hit of one ray; none when it misses.
  std::optional<RayHit> Cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const;
  /// Point of the mesh nearest to `point` in double precision, none when farther than `radius`.
  std::optional<Eigen::Vector3d> ClosestPoint(const Eigen::Vector3d& point, double radius) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace rilievo::simulation
