// Renders the images of a scene and answers exact questions about what they show.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "block/pixels.h"
#include "simulation/image_sampler.h"
#include "simulation/ray_caster.h"
#include "simulation/scene.h"
#include "simulation/surface.h"

namespace rilievo::simulation {

/// Depth Z in the camera frame at the pixels' centres, row-major, metres; 0 where nothing is seen.
struct DepthImage {
  int width_px = 0, height_px = 0;
  std::vector<float> depth_m;
};

/// Holds the surface and its ray caster. All methods are const, thread safe and give the same bytes on every call.
///
/// Image formation: radiance = exposure * shade * albedo with a texture whose octaves fade out by the footprint of its
/// samples on the surface, weighed by the point spread function (pixel's box and Gaussian), see image_sampler.h. Then
/// vignetting, noise and quantisation.
class Renderer {
 public:
  /// Builds the mesh and the ray caster. Throws Error when memory is short.
  explicit Renderer(const Scene& scene);
  ~Renderer();
  Renderer(const Renderer&) = delete;
  Renderer& operator=(const Renderer&) = delete;

  const Scene& scene() const { return scene_; }
  const Surface& surface() const { return surface_; }

  /// The whole image as a camera would store it. Cost about 0.25 us a pixel.
  GreyImage RenderGrey(std::size_t image) const;
  /// Noise-free radiance of a window (full range = 1), row-major. `samples` = 1: what RenderGrey quantises; 4,
  /// 8, 12...: the reference with that many rays a pixel along each axis.
  std::vector<float> RenderRadiance(std::size_t image, const Window& window, int samples) const;
  DepthImage RenderDepth(std::size_t image) const;

  /// The surface point seen at a pixel, exact in double precision; none where nothing is seen.
  std::optional<Eigen::Vector3d> SurfacePoint(std::size_t image, const Eigen::Vector2d& pixel_px) const;
  /// Exact projection of a world point inside the image's borders; none outside.
  std::optional<Eigen::Vector2d> Project(std::size_t image, const Eigen::Vector3d& point_m) const;
  /// True when `point_m` (on the surface) is inside the image and nothing hides it.
  bool Visible(const Eigen::Vector3d& point_m, std::size_t image) const;
  /// Nearest point of the true surface within `radius_m`.
  std::optional<Eigen::Vector3d> ClosestPoint(const Eigen::Vector3d& point_m, double radius_m) const;

 private:
  Scene scene_;
  Surface surface_;
  std::vector<NoiseOctave> texture_;
  RayCaster caster_;
};

/// Upper bounds: what a Renderer holds, shared by all images, and what each call of RenderGrey adds.
struct RenderBytes {
  std::uint64_t shared = 0, per_image = 0;
};
RenderBytes EstimateRenderBytes(const Scene& scene);
/// Both together: one renderer at work on one image.
std::uint64_t RenderPeakBytes(const Scene& scene);

}  // namespace rilievo::simulation
