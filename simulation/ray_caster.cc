// Embree behind its wall.
#include "simulation/ray_caster.h"

#include <embree3/rtcore.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "base/error.h"

namespace rilievo::simulation {
namespace {

/// Nearest point of triangle abc to p (Ericson, Real-Time Collision Detection, 2005, section 5.1.5).
Eigen::Vector3d ClosestPointOfTriangle(const Eigen::Vector3d& p, const std::array<Eigen::Vector3d, 3>& corner) {
  const auto& [a, b, c] = corner;
  const Eigen::Vector3d ab = b - a, ac = c - a, ap = p - a, bp = p - b, cp = p - c;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap), d3 = ab.dot(bp), d4 = ac.dot(bp), d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d1 <= 0 && d2 <= 0) return a;
  if (d3 >= 0 && d4 <= d3) return b;
  if (d6 >= 0 && d5 <= d6) return c;
  const double vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + d1 / (d1 - d3) * ab;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + d2 / (d2 - d6) * ac;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b);
  const double sum = va + vb + vc;
  return a + vb / sum * ab + vc / sum * ac;
}

struct ClosestQuery {
  const Surface* surface = nullptr;
  Eigen::Vector3d point;
  double best_squared = std::numeric_limits<double>::infinity();
  Eigen::Vector3d best = Eigen::Vector3d::Zero();
};

std::array<Eigen::Vector3d, 3> Corners(const Surface& surface, std::uint32_t triangle) {
  const auto& [a, b, c] = surface.triangles[triangle];
  return {surface.vertices_m[a].cast<double>(), surface.vertices_m[b].cast<double>(),
          surface.vertices_m[c].cast<double>()};
}

bool VisitTriangle(RTCPointQueryFunctionArguments* arguments) {
  auto& query = *static_cast<ClosestQuery*>(arguments->userPtr);
  const Eigen::Vector3d nearest = ClosestPointOfTriangle(query.point, Corners(*query.surface, arguments->primID));
  const double squared = (nearest - query.point).squaredNorm();
  if (squared >= query.best_squared) return false;
  query.best_squared = squared;
  query.best = nearest;
  arguments->query->radius = static_cast<float>(std::sqrt(squared) * (1 + 1e-6));
  return true;
}

}  // namespace

struct RayCaster::State {
  const Surface& surface;
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
};

RayCaster::RayCaster(const Surface& surface) : state_(new State{surface}) {
  state_->device = rtcNewDevice("threads=1,set_affinity=0");
  if (state_->device == nullptr)
    throw Error(ErrorCode::kInternal, "",
                "the ray caster (Embree) does not start, error " + std::to_string(rtcGetDeviceError(nullptr)));
  state_->scene = rtcNewScene(state_->device);
  rtcSetSceneFlags(state_->scene, static_cast<RTCSceneFlags>(RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_COMPACT));
  rtcSetSceneBuildQuality(state_->scene, RTC_BUILD_QUALITY_MEDIUM);
  RTCGeometry geometry = rtcNewGeometry(state_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  // Embree reads 16 bytes at each vertex; the buffer of 12-byte vertices is copied so that it can pad the last one.
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                               3 * sizeof(float), surface.vertices_m.size()));
  auto* indices = static_cast<std::uint32_t*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(std::uint32_t), surface.triangles.size()));
  if (vertices == nullptr || indices == nullptr)
    throw Error(ErrorCode::kOutOfMemoryBudget, "", "the surface does not fit into memory",
                "use fewer --surface-points");
  std::copy_n(surface.vertices_m.data()->data(), 3 * surface.vertices_m.size(), vertices);
  std::copy_n(surface.triangles.data()->data(), 3 * surface.triangles.size(), indices);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(state_->scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(state_->scene);
  if (rtcGetDeviceError(state_->device) != RTC_ERROR_NONE)
    throw Error(ErrorCode::kOutOfMemoryBudget, "", "the ray caster cannot hold the surface",
                "use fewer --surface-points");
}

RayCaster::~RayCaster() {
  rtcReleaseScene(state_->scene);
  rtcReleaseDevice(state_->device);
}

void RayCaster::Cast(const Eigen::Vector3f& origin, RayPacket& packet) const {
  alignas(64) static constexpr std::array<int, kPacket> kAll{-1, -1, -1, -1, -1, -1, -1, -1,
                                                             -1, -1, -1, -1, -1, -1, -1, -1};
  RTCRayHit16 rays;
  for (int i = 0; i < kPacket; ++i) {
    rays.ray.org_x[i] = origin.x(), rays.ray.org_y[i] = origin.y(), rays.ray.org_z[i] = origin.z();
    rays.ray.dir_x[i] = packet.dx[i], rays.ray.dir_y[i] = packet.dy[i], rays.ray.dir_z[i] = packet.dz[i];
    rays.ray.tnear[i] = 0, rays.ray.tfar[i] = std::numeric_limits<float>::infinity(), rays.ray.time[i] = 0;
    rays.ray.mask[i] = ~0U, rays.ray.id[i] = 0, rays.ray.flags[i] = 0;
    rays.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID, rays.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcIntersect16(kAll.data(), state_->scene, &context, &rays);
  for (int i = 0; i < kPacket; ++i) {
    const bool hit = rays.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
    packet.t[i] = hit ? rays.ray.tfar[i] : std::numeric_limits<float>::infinity();
    packet.u[i] = hit ? rays.hit.u[i] : 0;
    packet.v[i] = hit ? rays.hit.v[i] : 0;
    packet.triangle[i] = hit ? rays.hit.primID[i] : 0;
  }
}

std::optional<RayHit> RayCaster::Cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const {
  RTCRayHit ray{};
  ray.ray.org_x = static_cast<float>(origin.x()), ray.ray.org_y = static_cast<float>(origin.y()),
  ray.ray.org_z = static_cast<float>(origin.z());
  ray.ray.dir_x = static_cast<float>(direction.x()), ray.ray.dir_y = static_cast<float>(direction.y()),
  ray.ray.dir_z = static_cast<float>(direction.z());
  ray.ray.tfar = std::numeric_limits<float>::infinity();
  ray.ray.mask = ~0U;
  ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(state_->scene, &context, &ray);
  if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  const auto corner = Corners(state_->surface, ray.hit.primID);
  const Eigen::Vector3d normal = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
  RayHit hit;
  hit.t = normal.dot(corner[0] - origin) / normal.dot(direction);
  if (!std::isfinite(hit.t)) return std::nullopt;  // the triangle is seen exactly from its edge
  hit.point = origin + hit.t * direction;
  hit.triangle = ray.hit.primID;
  return hit;
}

std::optional<Eigen::Vector3d> RayCaster::ClosestPoint(const Eigen::Vector3d& point, double radius) const {
  ClosestQuery query{&state_->surface, point, radius * radius};
  RTCPointQuery where{static_cast<float>(point.x()), static_cast<float>(point.y()), static_cast<float>(point.z()), 0,
                      static_cast<float>(radius * (1 + 1e-6))};
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  const double start = query.best_squared;
  rtcPointQuery(state_->scene, &where, &context, VisitTriangle, &query);
  if (!(query.best_squared < start)) return std::nullopt;
  return query.best;
}

}  // namespace rilievo::simulation
