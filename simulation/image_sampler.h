// The optical image of one view by ray casting: radiance at the sensor before vignetting and electronics, and depth.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "simulation/noise.h"
#include "simulation/psf.h"
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

/// A block of pixels: columns x..x+width, rows y..y+height.
struct Window {
  int x_px = 0, y_px = 0, width_px = 0, height_px = 0;
};

class ImageSampler {
 public:
  ImageSampler(const SceneView& view, std::size_t image);

  /// Radiance of a window inside the image, row-major. One ray a pixel, at its centre, gives the surface; the texture
  /// is sampled 2 x 2 times a pixel on the tangent plane there. Pixels at silhouettes get 4 x 4 rays. The point spread
  /// function weighs those sub-samples. Beyond the window (or the image) the border's pixels repeat. `depth_m`: if not
  /// null, receives Z in the camera frame at the pixels' centres, 0 where nothing is hit.
  std::vector<float> Render(const Window& window, std::vector<float>* depth_m) const;
  /// The same optical image from samples^2 rays a pixel and no tangent planes, the texture faded for their smaller
  /// footprint: what Render converges to. Costs samples^2 times as much.
  std::vector<float> RenderReference(const Window& window, int samples) const;

 private:
  struct Strip;
  struct Footing;
  void Trace(double x_px, double y_px, double spacing_px, int width, Strip& strip) const;
  void Place(const RayPacket& packet, std::size_t lane, const Footing& footing, Strip& strip) const;
  void Texture(Strip& strip) const;
  void RefineEdges(int x_px, int y_px, int width, const std::vector<float>& above, const Strip* below,
                   Strip& strip) const;
  std::array<float, 4> Quadrants(int x_px, int y_px) const;
  float Radiance(float shade, float texture) const;

  const SceneView view_;
  RayGrid rays_;
  Eigen::Matrix3d world_from_cam_;
  Eigen::Vector3f center_m_, light_;
  /// Light from all around. A closed object is photographed from its shadow side too, which must not drown in the
  /// noise.
  float ambient_ = 0.50F;
  float exposure_ = 1, pixel_size_ = 1;  ///< pixel_size_: on the ideal image plane Z = 1
  NoiseKernel kernel_;
};

}  // namespace rilievo::simulation
