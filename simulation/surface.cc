// Builds displaced panels, spheres and bodies of revolution.
#include "simulation/surface.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/rng.h"
#include "base/units.h"

namespace rilievo::simulation {
namespace {

constexpr std::uint64_t kReliefKey = 0x72656c, kTextureKey = 0x746578;

/// Columns and rows of vertices. Closed objects: columns around (the last joins the first), rows between two poles.
struct GridSize {
  std::uint32_t columns = 0, rows = 0;
};

GridSize PlanGrid(const Scene& scene) {
  const double points = scene.options.surface_points;
  double aspect = 2;  // closed objects: the equator is twice as long as a meridian
  if (scene.options.surface == "relief")
    aspect = (scene.panel_m[1] - scene.panel_m[0]) / (scene.panel_m[3] - scene.panel_m[2]);
  if (scene.options.surface == "statue") aspect = 0.8;
  const double columns = std::clamp(std::round(std::sqrt(points * aspect)), 8.0, 60000.0);
  return {static_cast<std::uint32_t>(columns),
          static_cast<std::uint32_t>(std::clamp(std::round(points / columns), 8.0, 60000.0))};
}

bool IsClosed(const Scene& scene) { return scene.options.surface != "relief"; }

/// Radius of the statue at height h of [-1, 1], in units of half its height: foot, waist, shoulders, neck and head.
double StatueRadius(double h) {
  const auto bump = [h](double at, double width, double size) {
    const double d = (h - at) / width;
    return size * std::exp(-d * d);
  };
  const double body =
      0.17 + bump(-0.85, 0.22, 0.26) + bump(-0.35, 0.30, 0.13) + bump(0.28, 0.22, 0.20) + bump(0.78, 0.17, 0.14);
  return body * std::sqrt(std::max(0.0, 1 - std::pow(h, 8)));
}

Eigen::Vector3d ClosedPoint(const SceneOptions& o, double longitude_rad, double s) {
  const double half_m = 0.5 * o.object_size_m, polar = std::numbers::pi * s;  // s: 0 south pole .. 1 north pole
  const double y = -std::cos(polar);
  const double radius = o.surface == "sphere" ? std::sin(polar) : StatueRadius(y);
  return half_m * Eigen::Vector3d(radius * std::sin(longitude_rad), y, radius * std::cos(longitude_rad));
}

std::vector<Eigen::Vector3d> BaseVertices(const Scene& scene, GridSize grid) {
  std::vector<Eigen::Vector3d> base;
  const Eigen::Vector4d& p = scene.panel_m;
  for (std::uint32_t r = 0; r < grid.rows; ++r)
    for (std::uint32_t c = 0; c < grid.columns; ++c) {
      if (IsClosed(scene)) {
        base.push_back(
            ClosedPoint(scene.options, 2 * std::numbers::pi * c / grid.columns, (r + 1.0) / (grid.rows + 1.0)));
      } else {
        base.emplace_back(p[0] + (p[1] - p[0]) * c / (grid.columns - 1), p[2] + (p[3] - p[2]) * r / (grid.rows - 1),
                          0.0);
      }
    }
  if (IsClosed(scene)) {
    base.push_back(ClosedPoint(scene.options, 0, 0));
    base.push_back(ClosedPoint(scene.options, 0, 1));
  }
  return base;
}

std::vector<std::array<std::uint32_t, 3>> Triangles(bool closed, GridSize grid) {
  std::vector<std::array<std::uint32_t, 3>> triangles;
  const std::uint32_t columns = grid.columns, last = closed ? columns : columns - 1;
  for (std::uint32_t r = 0; r + 1 < grid.rows; ++r)
    for (std::uint32_t c = 0; c < last; ++c) {
      const std::uint32_t right = (c + 1) % columns, a = r * columns + c, b = r * columns + right, d = a + columns,
                          e = b + columns;
      triangles.push_back({a, b, e});
      triangles.push_back({a, e, d});
    }
  if (closed) {
    const std::uint32_t south = grid.rows * columns, north = south + 1, top = (grid.rows - 1) * columns;
    for (std::uint32_t c = 0; c < columns; ++c) {
      triangles.push_back({south, (c + 1) % columns, c});
      triangles.push_back({north, top + c, top + (c + 1) % columns});
    }
  }
  return triangles;
}

/// Area-weighted normals of the vertices.
std::vector<Eigen::Vector3f> SmoothNormals(const std::vector<Eigen::Vector3f>& vertices,
                                           const std::vector<std::array<std::uint32_t, 3>>& triangles) {
  std::vector<Eigen::Vector3f> normals(vertices.size(), Eigen::Vector3f::Zero());
  for (const auto& [a, b, c] : triangles) {
    const Eigen::Vector3f normal = (vertices[b] - vertices[a]).cross(vertices[c] - vertices[a]);
    for (const std::uint32_t v : {a, b, c}) normals[v] += normal;
  }
  for (auto& normal : normals) normal.normalize();
  return normals;
}

/// Height of the displacement along the base's normal, and across it for closed objects: from a third of the object
/// down to four mesh cells.
std::vector<float> Displacements(const Scene& scene, const std::vector<Eigen::Vector3d>& base, double step_m) {
  const double size_m = scene.options.object_size_m, first_cell_m = size_m / (IsClosed(scene) ? 3.5 : 2.5);
  const int count =
      std::clamp(1 + static_cast<int>(std::floor(std::log(first_cell_m / (4 * step_m)) / std::log(2.03))), 1, 9);
  const auto octaves = MakeOctaves({first_cell_m, 2.03, (IsClosed(scene) ? 0.0087 : 0.0173) * size_m, 0.47, count},
                                   SeedFor(static_cast<std::uint64_t>(scene.options.seed), kReliefKey));
  std::array<std::vector<float>, 4> at;
  for (auto& axis : at) axis.reserve(base.size());
  for (const auto& p : base) {
    for (int k = 0; k < 3; ++k) at[k].push_back(static_cast<float>(p[k]));
    at[3].push_back(0.0F);
  }
  std::vector<float> heights_m(base.size());
  SumNoise(SelectNoiseKernel(), octaves, {at[0].data(), at[1].data(), at[2].data(), at[3].data(), base.size()},
           heights_m.data());
  return heights_m;
}

double MeanStep(const Scene& scene, GridSize grid) {
  if (IsClosed(scene)) return std::numbers::pi * 0.5 * scene.options.object_size_m / grid.rows;
  return (scene.panel_m[1] - scene.panel_m[0]) / grid.columns;
}

}  // namespace

SurfaceSize PlannedSurfaceSize(const Scene& scene) {
  const GridSize grid = PlanGrid(scene);
  const std::uint64_t columns = grid.columns, rows = grid.rows;
  if (IsClosed(scene)) return {columns * rows + 2, 2 * columns * rows};
  return {columns * rows, 2 * (columns - 1) * (rows - 1)};
}

Surface MakeSurface(const Scene& scene) {
  const GridSize grid = PlanGrid(scene);
  const bool closed = IsClosed(scene);
  const auto base = BaseVertices(scene, grid);
  Surface surface;
  surface.triangles = Triangles(closed, grid);
  for (const auto& p : base) surface.vertices_m.push_back(p.cast<float>());
  const auto base_normals = closed ? SmoothNormals(surface.vertices_m, surface.triangles)
                                   : std::vector<Eigen::Vector3f>(base.size(), Eigen::Vector3f::UnitZ());
  const auto heights_m = Displacements(scene, base, MeanStep(scene, grid));
  for (std::size_t i = 0; i < base.size(); ++i) surface.vertices_m[i] += heights_m[i] * base_normals[i];
  surface.normals = SmoothNormals(surface.vertices_m, surface.triangles);
  return surface;
}

std::vector<NoiseOctave> TextureOctaves(const Scene& scene) {
  return MakeOctaves({scene.options.object_size_m / 3, 1.93, 1.25, 0.82, 20},
                     SeedFor(static_cast<std::uint64_t>(scene.options.seed), kTextureKey));
}

}  // namespace rilievo::simulation
