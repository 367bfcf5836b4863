// Optics and electronics of the camera, and the exact queries.
#include "simulation/renderer.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "base/rng.h"
#include "simulation/image_sampler.h"

namespace rilievo::simulation {
namespace {

/// Loss of light with the fourth power of the distance from the image's middle, `loss` in the corners.
void Vignette(std::vector<float>& radiance, const Window& window, const Camera& camera, double loss) {
  const float cx = 0.5F * camera.width_px, cy = 0.5F * camera.height_px, corner = 1 / (cx * cx + cy * cy);
  for (int y = 0; y < window.height_px; ++y)
    for (int x = 0; x < window.width_px; ++x) {
      const float dx = window.x_px + x + 0.5F - cx, dy = window.y_px + y + 0.5F - cy, r2 = (dx * dx + dy * dy) * corner;
      radiance[static_cast<std::size_t>(y) * window.width_px + x] *= 1 - static_cast<float>(loss) * r2 * r2;
    }
}

std::uint32_t Mix32(std::uint32_t x) {  // finaliser of MurmurHash3 (Appleby)
  x ^= x >> 16;
  x *= 0x85ebca6bU;
  x ^= x >> 13;
  x *= 0xc2b2ae35U;
  return x ^ (x >> 16);
}

/// Nearly normal with deviation 1: the sum of eight uniform bytes (excess kurtosis -0.15, range +-4.9), keyed by pixel.
float UnitNoise(std::uint32_t key, std::uint32_t pixel) {
  const std::uint32_t a = Mix32(pixel ^ key), b = Mix32(a + 0x9e3779b9U);
  constexpr std::uint32_t kMask = 0x00ff00ffU;
  std::uint32_t pairs = (a & kMask) + ((a >> 8) & kMask) + (b & kMask) + ((b >> 8) & kMask);
  pairs = (pairs & 0xffffU) + (pairs >> 16);
  // 8 bytes uniform on 0..255: mean 1020, variance 8 (256^2 - 1) / 12
  return (static_cast<float>(pairs) - 1020.0F) * (1.0F / 209.0215F);
}

template <class Pixel>
std::vector<Pixel> Quantise(const std::vector<float>& radiance, double noise, std::uint32_t key, float full) {
  std::vector<Pixel> pixels(radiance.size());
  const float amplitude = static_cast<float>(noise) * full;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const float value = radiance[i] * full + amplitude * UnitNoise(key, static_cast<std::uint32_t>(i));
    pixels[i] = static_cast<Pixel>(std::clamp(value + 0.5F, 0.0F, full));
  }
  return pixels;
}

}  // namespace

Renderer::Renderer(const Scene& scene)
    : scene_(scene), surface_(MakeSurface(scene_)), texture_(TextureOctaves(scene_)), caster_(surface_) {}
Renderer::~Renderer() = default;

GreyImage Renderer::RenderGrey(std::size_t image) const {
  RILIEVO_CHECK(image < scene_.names.size());
  const SceneOptions& o = scene_.options;
  const Window whole{0, 0, scene_.camera.width_px, scene_.camera.height_px};
  auto radiance = ImageSampler({scene_, surface_, caster_, texture_}, image).Render(whole, nullptr);
  Vignette(radiance, whole, scene_.camera, o.vignetting);
  const auto key = static_cast<std::uint32_t>(SeedFor(static_cast<std::uint64_t>(o.seed), 0x6e6f6973, image));
  GreyImage result;
  result.width_px = whole.width_px;
  result.height_px = whole.height_px;
  if (o.bits == "16") {
    result.u16 = Quantise<std::uint16_t>(radiance, o.noise, key, 65535.0F);
  } else {
    result.u8 = Quantise<std::uint8_t>(radiance, o.noise, key, 255.0F);
  }
  return result;
}

std::vector<float> Renderer::RenderRadiance(std::size_t image, const Window& window, int samples) const {
  const Camera& camera = scene_.camera;
  RILIEVO_CHECK(image < scene_.names.size() && window.x_px >= 0 && window.y_px >= 0 && window.width_px > 0 &&
                window.height_px > 0);
  RILIEVO_CHECK(window.x_px + window.width_px <= camera.width_px && window.y_px + window.height_px <= camera.height_px);
  // As far as the point spread function and the search for edges reach.
  const int margin_px = Psf(scene_.options.blur_px, 1).radius_px + 1;
  const int x0 = std::max(0, window.x_px - margin_px), y0 = std::max(0, window.y_px - margin_px);
  const Window block{x0, y0, std::min(camera.width_px, window.x_px + window.width_px + margin_px) - x0,
                     std::min(camera.height_px, window.y_px + window.height_px + margin_px) - y0};
  const ImageSampler sampler({scene_, surface_, caster_, texture_}, image);
  auto radiance = samples > 1 ? sampler.RenderReference(block, samples) : sampler.Render(block, nullptr);
  Vignette(radiance, block, camera, scene_.options.vignetting);
  std::vector<float> result;
  for (int y = 0; y < window.height_px; ++y) {
    const auto row =
        radiance.begin() + static_cast<std::ptrdiff_t>(window.y_px - y0 + y) * block.width_px + (window.x_px - x0);
    result.insert(result.end(), row, row + window.width_px);
  }
  return result;
}

DepthImage Renderer::RenderDepth(std::size_t image) const {
  RILIEVO_CHECK(image < scene_.names.size());
  DepthImage depth{scene_.camera.width_px, scene_.camera.height_px, {}};
  depth.depth_m.reserve(static_cast<std::size_t>(depth.width_px) * depth.height_px);
  ImageSampler({scene_, surface_, caster_, texture_}, image)
      .Render({0, 0, depth.width_px, depth.height_px}, &depth.depth_m);
  return depth;
}

std::optional<Eigen::Vector3d> Renderer::SurfacePoint(std::size_t image, const Eigen::Vector2d& pixel_px) const {
  const auto ideal = scene_.camera.model.Normalize(pixel_px);
  if (!ideal) return std::nullopt;
  const Rigid3& pose = scene_.cam_from_world.at(image);
  const auto hit = caster_.Cast(pose.Center(), pose.rotation.conjugate() * ideal->homogeneous());
  return hit ? std::optional(hit->point) : std::nullopt;
}

std::optional<Eigen::Vector2d> Renderer::Project(std::size_t image, const Eigen::Vector3d& point_m) const {
  const auto pixel = scene_.camera.model.Project(scene_.cam_from_world.at(image) * point_m);
  if (!pixel || !(pixel->x() >= 0 && pixel->y() >= 0 && pixel->x() <= scene_.camera.width_px &&
                  pixel->y() <= scene_.camera.height_px))
    return std::nullopt;
  return pixel;
}

bool Renderer::Visible(const Eigen::Vector3d& point_m, std::size_t image) const {
  if (!Project(image, point_m)) return false;
  const Eigen::Vector3d center = scene_.cam_from_world.at(image).Center(), direction = point_m - center;
  const auto hit = caster_.Cast(center, direction);
  return !hit || hit->t > 1 - 2e-5;  // single-precision ray: a margin of 20 um a metre
}

std::optional<Eigen::Vector3d> Renderer::ClosestPoint(const Eigen::Vector3d& point_m, double radius_m) const {
  return caster_.ClosestPoint(point_m, radius_m);
}

RenderBytes EstimateRenderBytes(const Scene& scene) {
  const SurfaceSize size = PlannedSurfaceSize(scene);
  const auto w = static_cast<std::uint64_t>(scene.camera.width_px),
             h = static_cast<std::uint64_t>(scene.camera.height_px);
  RenderBytes bytes;
  // Surface while it is made (base points in double, displacement arrays), then Embree's copy and hierarchy.
  bytes.shared = 64 * size.vertices + (12 + 12 + 160) * size.triangles + (std::uint64_t{8} << 20);
  // Radiance and depth or the pixels, two strips of rays with four sub-samples, the rows of the point spread function
  // (at most 33 pixels), the grid of rays.
  bytes.per_image = w * h * (4 + 4) + w * (2 * 4 * (4 * 24 + 24) + 66 * 4 + 64) + w * h / 12 + (std::uint64_t{1} << 20);
  return bytes;
}

std::uint64_t RenderPeakBytes(const Scene& scene) {
  const RenderBytes bytes = EstimateRenderBytes(scene);
  return bytes.shared + bytes.per_image;
}

}  // namespace rilievo::simulation
