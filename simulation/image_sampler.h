// Radiance and depth of one image by ray casting, before the camera's optics and electronics.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "simulation/noise.h"
#include "simulation/ray_caster.h"
#include "simulation/ray_grid.h"
#include "simulation/scene.h"
#include "simulation/surface.h"

namespace rilievo::simulation {

/// What a scene's surface looks like, shared by all its images.
struct SceneView {
  const Scene& scene;
  const Surface& surface;
  const RayCaster& caster;
  const std::vector<NoiseOctave>& texture;
};

/// A block of pixels, row-major; depth is Z in the camera frame, 0 where nothing is hit.
struct Samples {
  int x_px = 0, y_px = 0, width_px = 0, height_px = 0;
  std::vector<float> radiance, depth_m;
};

class ImageSampler {
 public:
  ImageSampler(const SceneView& view, std::size_t image);

  /// One ray at each pixel's centre; pixels at depth discontinuities get 4 x 4 rays. The block may reach over the image's
  /// border by at most 16 px to the right and below, none to the left and above.
  Samples Render(int x_px, int y_px, int width_px, int height_px) const;
  /// The mean of samples^2 rays a pixel, texture faded for their smaller footprint.
  Samples RenderSupersampled(int x_px, int y_px, int width_px, int height_px, int samples) const;

 private:
  struct Strip;
  void Trace(double x_px, double y_px, float footprint_scale, Strip& strip, Samples& samples, int row) const;
  void Shade(const RayPacket& packet, std::size_t at, float footprint_scale, Strip& strip) const;
  float Radiance(float shade, float texture) const;
  void RefineEdges(Samples& samples) const;

  const SceneView view_;
  RayGrid rays_;
  Eigen::Matrix3d world_from_cam_;
  Eigen::Vector3f center_m_, light_;
  float exposure_ = 1, pixel_size_ = 1;  ///< pixel_size_: of the ideal image plane Z = 1
  NoiseKernel kernel_;
};

}  // namespace rilievo::simulation
