// The true surface of a scene: a triangle mesh, its smooth normals and its texture.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "simulation/noise.h"
#include "simulation/scene.h"

namespace rilievo::simulation {

/// Vertices in world metres; triangles counter-clockwise seen from outside (a relief: from +z). The triangles
/// themselves are the truth; the normals only shade.
struct Surface {
  std::vector<Eigen::Vector3f> vertices_m, normals;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// Deterministic; cost about 0.3 us a vertex.
Surface MakeSurface(const Scene& scene);

/// Vertices and triangles MakeSurface gives, without making it.
struct SurfaceSize {
  std::uint64_t vertices = 0, triangles = 0;
};
SurfaceSize PlannedSurfaceSize(const Scene& scene);

/// Octaves of the surface's brightness, from a third of the object down to 1/250,000 of it.
std::vector<NoiseOctave> TextureOctaves(const Scene& scene);

}  // namespace rilievo::simulation
