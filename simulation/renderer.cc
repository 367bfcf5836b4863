// Optics and electronics of the camera, and the exact queries.
#include "simulation/renderer.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "base/rng.h"
#include "simulation/image_sampler.h"

namespace rilievo::simulation {
namespace {

constexpr int kMaxBlur_px = 16;  // the ray grid reaches this far over the border

/// Rays never start left of or above the image, so blocks are cut off there and the blur repeats the border's pixels.
struct Reach {
  int x0, y0, x1, y1;
};

Reach WithMargin(const Window& window, int margin_px, const Camera& camera) {
  return {std::max(0, window.x_px - margin_px), std::max(0, window.y_px - margin_px),
          std::min(camera.width_px, window.x_px + window.width_px + margin_px),
          std::min(camera.height_px, window.y_px + window.height_px + margin_px)};
}

std::vector<float> GaussianTaps(double sigma_px) {
  if (sigma_px <= 0) return {1.0F};
  const int radius = std::clamp(static_cast<int>(std::ceil(4 * sigma_px)), 1, kMaxBlur_px);
  std::vector<double> taps;
  double sum = 0;
  for (int i = -radius; i <= radius; ++i) sum += taps.emplace_back(std::exp(-0.5 * i * i / (sigma_px * sigma_px)));
  std::vector<float> result;
  for (const double tap : taps) result.push_back(static_cast<float>(tap / sum));
  return result;
}

/// out[i] = sum over k of taps[k] * in[clamp(i + k - radius)], added up in the order of k.
void BlurRow(const float* in, int n, const std::vector<float>& taps, std::vector<float>& padded, float* out) {
  const int radius = static_cast<int>(taps.size()) / 2;
  padded.resize(static_cast<std::size_t>(n) + 2 * radius);
  for (int i = 0; i < n + 2 * radius; ++i) padded[i] = in[std::clamp(i - radius, 0, n - 1)];
  std::fill(out, out + n, 0.0F);
  for (std::size_t k = 0; k < taps.size(); ++k) {
    const float tap = taps[k];
    const float* source = padded.data() + k;
    for (int i = 0; i < n; ++i) out[i] += tap * source[i];
  }
}

/// Separable Gaussian in place; the border is continued. Holds 2 * radius + 2 rows beside the image.
void Blur(Samples& samples, double sigma_px) {
  const auto taps = GaussianTaps(sigma_px);
  if (taps.size() == 1) return;
  const int w = samples.width_px, h = samples.height_px, radius = static_cast<int>(taps.size()) / 2, ring = 2 * radius + 1;
  std::vector<float> padded, rows(static_cast<std::size_t>(ring) * w), sum(w);
  const auto row = [&](int y) { return rows.data() + static_cast<std::size_t>(std::clamp(y, 0, h - 1) % ring) * w; };
  int filled = 0;
  for (int y = 0; y < h; ++y) {
    for (; filled <= std::min(y + radius, h - 1); ++filled)
      BlurRow(samples.radiance.data() + static_cast<std::size_t>(filled) * w, w, taps, padded, row(filled));
    std::fill(sum.begin(), sum.end(), 0.0F);
    for (int k = 0; k < ring; ++k) {
      const float tap = taps[k];
      const float* source = row(y + k - radius);
      for (int x = 0; x < w; ++x) sum[x] += tap * source[x];
    }
    std::copy(sum.begin(), sum.end(), samples.radiance.begin() + static_cast<std::ptrdiff_t>(y) * w);
  }
}

/// Loss of light with the fourth power of the distance from the image's middle, `loss` in the corners.
void Vignette(Samples& samples, const Camera& camera, double loss) {
  const float cx = 0.5F * camera.width_px, cy = 0.5F * camera.height_px, corner = 1 / (cx * cx + cy * cy);
  for (int y = 0; y < samples.height_px; ++y)
    for (int x = 0; x < samples.width_px; ++x) {
      const float dx = samples.x_px + x + 0.5F - cx, dy = samples.y_px + y + 0.5F - cy, r2 = (dx * dx + dy * dy) * corner;
      samples.radiance[static_cast<std::size_t>(y) * samples.width_px + x] *= 1 - static_cast<float>(loss) * r2 * r2;
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
std::vector<Pixel> Quantise(const Samples& samples, double noise, std::uint32_t key, float full) {
  std::vector<Pixel> pixels(samples.radiance.size());
  const float amplitude = static_cast<float>(noise) * full;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const float value = samples.radiance[i] * full + amplitude * UnitNoise(key, static_cast<std::uint32_t>(i));
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
  const ImageSampler sampler({scene_, surface_, caster_, texture_}, image);
  const int w = scene_.camera.width_px, h = scene_.camera.height_px;
  Samples samples = o.samples == 1 ? sampler.Render(0, 0, w, h) : sampler.RenderSupersampled(0, 0, w, h, o.samples);
  samples.depth_m = {};
  Blur(samples, o.blur_px);
  Vignette(samples, scene_.camera, o.vignetting);
  const auto key = static_cast<std::uint32_t>(SeedFor(static_cast<std::uint64_t>(o.seed), 0x6e6f6973, image));
  GreyImage result;
  result.width_px = w;
  result.height_px = h;
  if (o.bits == 16) {
    result.u16 = Quantise<std::uint16_t>(samples, o.noise, key, 65535.0F);
  } else {
    result.u8 = Quantise<std::uint8_t>(samples, o.noise, key, 255.0F);
  }
  return result;
}

std::vector<float> Renderer::RenderRadiance(std::size_t image, const Window& window, int samples) const {
  RILIEVO_CHECK(image < scene_.names.size() && window.x_px >= 0 && window.y_px >= 0 && window.width_px > 0 && window.height_px > 0);
  RILIEVO_CHECK(window.x_px + window.width_px <= scene_.camera.width_px && window.y_px + window.height_px <= scene_.camera.height_px);
  const ImageSampler sampler({scene_, surface_, caster_, texture_}, image);
  // One more pixel than the blur needs, so that edges are found as in the whole image.
  const Reach reach = WithMargin(window, static_cast<int>(GaussianTaps(scene_.options.blur_px).size()) / 2 + 1, scene_.camera);
  const int w = reach.x1 - reach.x0, h = reach.y1 - reach.y0;
  Samples block = samples == 1 ? sampler.Render(reach.x0, reach.y0, w, h) : sampler.RenderSupersampled(reach.x0, reach.y0, w, h, samples);
  Blur(block, scene_.options.blur_px);
  Vignette(block, scene_.camera, scene_.options.vignetting);
  std::vector<float> result;
  for (int y = 0; y < window.height_px; ++y) {
    const auto row = block.radiance.begin() + static_cast<std::ptrdiff_t>(window.y_px - reach.y0 + y) * w + (window.x_px - reach.x0);
    result.insert(result.end(), row, row + window.width_px);
  }
  return result;
}

DepthImage Renderer::RenderDepth(std::size_t image) const {
  RILIEVO_CHECK(image < scene_.names.size());
  const ImageSampler sampler({scene_, surface_, caster_, texture_}, image);
  const int w = scene_.camera.width_px, h = scene_.camera.height_px;
  return {w, h, sampler.RenderSupersampled(0, 0, w, h, 1).depth_m};
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
  if (!pixel || !(pixel->x() >= 0 && pixel->y() >= 0 && pixel->x() <= scene_.camera.width_px && pixel->y() <= scene_.camera.height_px))
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
  const auto w = static_cast<std::uint64_t>(scene.camera.width_px), h = static_cast<std::uint64_t>(scene.camera.height_px);
  RenderBytes bytes;
  // Surface while it is made (base points in double, displacement arrays), then Embree's copy and hierarchy.
  bytes.shared = 64 * size.vertices + (12 + 12 + 160) * size.triangles + (std::uint64_t{8} << 20);
  bytes.per_image = w * h * (4 + 4 + 2) + 600 * w + w * h / 8 + (std::uint64_t{1} << 20);
  return bytes;
}

std::uint64_t RenderPeakBytes(const Scene& scene) {
  const RenderBytes bytes = EstimateRenderBytes(scene);
  return bytes.shared + bytes.per_image;
}

}  // namespace rilievo::simulation
