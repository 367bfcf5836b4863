// Casts rays in packets of 4 x 4 pixels and shades what they hit.
#include "simulation/image_sampler.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/check.h"

namespace rilievo::simulation {
namespace {

constexpr float kBackground = 0.03F;
constexpr int kSide = 4;       // packets are 4 x 4 pixels; edge pixels get 4 x 4 rays
constexpr float kFar = 1e30F;  // footprint of a miss: every octave is faded out

}  // namespace

/// Four rows of pixels in the order of the packets: lane = 16 * (x / 4) + 4 * (row) + x % 4.
struct ImageSampler::Strip {
  std::array<std::vector<Eigen::Vector2d>, kSide> ideal;
  std::vector<float> x_m, y_m, z_m, footprint_m, shade, depth_m, texture;

  void Resize(std::size_t lanes) {
    for (auto* v : {&x_m, &y_m, &z_m, &footprint_m, &shade, &depth_m, &texture}) v->resize(lanes);
  }
};

ImageSampler::ImageSampler(const SceneView& view, std::size_t image)
    : view_(view), rays_(view.scene.camera), kernel_(SelectNoiseKernel()) {
  const Rigid3& pose = view.scene.cam_from_world.at(image);
  world_from_cam_ = pose.rotation.conjugate().toRotationMatrix();
  center_m_ = pose.Center().cast<float>();
  light_ = Eigen::Vector3f(-0.55F, 0.60F, 0.58F).normalized();
  exposure_ = static_cast<float>(view.scene.exposures.at(image));
  pixel_size_ = static_cast<float>(1.0 / view.scene.camera.model.MeanFocal());
}

/// Half Lambert: a cosine from 0 to 1 over the whole sphere, squared, so that no terminator makes an edge.
void ImageSampler::Shade(const RayPacket& packet, std::size_t at, float footprint_scale, Strip& strip) const {
  for (int i = 0; i < kPacket; ++i) {
    const std::size_t lane = at + i;
    if (!std::isfinite(packet.t[i])) {
      strip.x_m[lane] = strip.y_m[lane] = strip.z_m[lane] = strip.shade[lane] = strip.depth_m[lane] = 0;
      strip.footprint_m[lane] = kFar;
      continue;
    }
    const auto& [a, b, c] = view_.surface.triangles[packet.triangle[i]];
    const float u = packet.u[i], v = packet.v[i], t = packet.t[i];
    const auto& n = view_.surface.normals;
    const Eigen::Vector3f normal = ((1 - u - v) * n[a] + (u * n[b] + v * n[c])).normalized();
    const Eigen::Vector3f direction(packet.dx[i], packet.dy[i], packet.dz[i]);
    const Eigen::Vector3f point = center_m_ + t * direction;
    strip.x_m[lane] = point.x(), strip.y_m[lane] = point.y(), strip.z_m[lane] = point.z();
    // The direction has Z = 1 in the camera frame, so t is the depth; a pixel's longer axis on the surface is
    // (t |d| pixel) / cos with cos = |n d| / |d|.
    const float facing = std::max(std::abs(normal.dot(direction)), 1e-3F);
    strip.footprint_m[lane] = footprint_scale * pixel_size_ * t * direction.squaredNorm() / facing;
    const float half = 0.5F + 0.5F * normal.dot(light_);
    strip.shade[lane] = 0.10F + 1.15F * half * half;
    strip.depth_m[lane] = t;
  }
}

float ImageSampler::Radiance(float shade, float texture) const {
  if (shade == 0) return kBackground * exposure_;
  const float s = 0.22F * texture;
  const float albedo = 0.56F + 0.42F * s / std::sqrt(1 + s * s);
  return exposure_ * shade * albedo;
}

void ImageSampler::Trace(double x_px, double y_px, float footprint_scale, Strip& strip, Samples& samples, int row) const {
  const int width = (samples.width_px + kSide - 1) / kSide * kSide;
  strip.Resize(static_cast<std::size_t>(width) * kSide);
  for (int r = 0; r < kSide; ++r) rays_.Row(x_px, y_px + r, width, strip.ideal[r]);
  RayPacket packet;
  for (int x = 0; x < width; x += kSide) {
    for (int i = 0; i < kPacket; ++i) {
      const Eigen::Vector2d& ideal = strip.ideal[i / kSide][x + i % kSide];
      const Eigen::Vector3d direction = world_from_cam_.col(0) * ideal.x() + world_from_cam_.col(1) * ideal.y() + world_from_cam_.col(2);
      packet.dx[i] = static_cast<float>(direction.x()), packet.dy[i] = static_cast<float>(direction.y()),
      packet.dz[i] = static_cast<float>(direction.z());
    }
    view_.caster.Cast(center_m_, packet);
    Shade(packet, static_cast<std::size_t>(x) * kSide, footprint_scale, strip);
  }
  SumNoise(kernel_, view_.texture,
           {strip.x_m.data(), strip.y_m.data(), strip.z_m.data(), strip.footprint_m.data(), strip.x_m.size()}, strip.texture.data());
  for (int r = 0; r < kSide && row + r < samples.height_px; ++r)
    for (int x = 0; x < samples.width_px; ++x) {
      const std::size_t lane = static_cast<std::size_t>(x / kSide) * kPacket + r * kSide + x % kSide;
      const std::size_t pixel = static_cast<std::size_t>(row + r) * samples.width_px + x;
      samples.radiance[pixel] += Radiance(strip.shade[lane], strip.texture[lane]);
      samples.depth_m[pixel] = strip.depth_m[lane];
    }
}

Samples ImageSampler::Render(int x_px, int y_px, int width_px, int height_px) const {
  Samples samples = RenderSupersampled(x_px, y_px, width_px, height_px, 1);
  RefineEdges(samples);
  return samples;
}

Samples ImageSampler::RenderSupersampled(int x_px, int y_px, int width_px, int height_px, int samples) const {
  RILIEVO_CHECK(samples >= 1 && x_px >= 0 && y_px >= 0 && width_px > 0 && height_px > 0);
  Samples result{x_px, y_px, width_px, height_px, {}, {}};
  const std::size_t pixels = static_cast<std::size_t>(width_px) * height_px;
  result.radiance.assign(pixels, 0.0F);
  result.depth_m.assign(pixels, 0.0F);
  Strip strip;
  const float scale = 1.0F / static_cast<float>(samples);
  for (int row = 0; row < height_px; row += kSide)
    for (int k = 0; k < samples * samples; ++k)
      Trace(x_px + (k % samples + 0.5) / samples, y_px + row + (k / samples + 0.5) / samples, scale, strip, result, row);
  if (samples > 1)
    for (float& value : result.radiance) value *= scale * scale;
  return result;
}

/// On a plane 1 / Z is linear in the image: a second difference of more than 8 pixel sizes is an edge.
void ImageSampler::RefineEdges(Samples& samples) const {
  const int w = samples.width_px, h = samples.height_px;
  const auto inverse = [&](int x, int y) {
    const float depth_m = samples.depth_m[static_cast<std::size_t>(std::clamp(y, 0, h - 1)) * w + std::clamp(x, 0, w - 1)];
    return depth_m > 0 ? 1 / depth_m : 0.0F;
  };
  Strip strip;
  strip.Resize(kPacket);
  RayPacket packet;
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      const float here = inverse(x, y);
      const float bend = std::max(std::abs(2 * here - inverse(x - 1, y) - inverse(x + 1, y)),
                                  std::abs(2 * here - inverse(x, y - 1) - inverse(x, y + 1)));
      const float largest = std::max({here, inverse(x - 1, y), inverse(x + 1, y), inverse(x, y - 1), inverse(x, y + 1)});
      if (!(bend > 8 * pixel_size_ * largest)) continue;
      for (int i = 0; i < kPacket; ++i) {
        const Eigen::Vector2d ideal = rays_.At(samples.x_px + x + (i % kSide + 0.5) / kSide, samples.y_px + y + (i / kSide + 0.5) / kSide);
        const Eigen::Vector3f direction = (world_from_cam_ * ideal.homogeneous()).cast<float>();
        packet.dx[i] = direction.x(), packet.dy[i] = direction.y(), packet.dz[i] = direction.z();
      }
      view_.caster.Cast(center_m_, packet);
      Shade(packet, 0, 1.0F / kSide, strip);
      SumNoise(kernel_, view_.texture, {strip.x_m.data(), strip.y_m.data(), strip.z_m.data(), strip.footprint_m.data(), kPacket},
               strip.texture.data());
      float sum = 0;
      for (int i = 0; i < kPacket; ++i) sum += Radiance(strip.shade[i], strip.texture[i]);
      samples.radiance[static_cast<std::size_t>(y) * w + x] = sum / kPacket;
    }
}

}  // namespace rilievo::simulation
