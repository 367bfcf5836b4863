// Casts rays in packets of 4 x 4 pixels, shades what they hit and gathers it by the point spread function.
#include "simulation/image_sampler.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace rilievo::simulation {
namespace {

constexpr float kBackground = 0.03F;
constexpr int kSide = 4;       // packets are 4 x 4 pixels; edge pixels get 4 x 4 rays
constexpr int kSubs = 4;       // sub-samples of the texture a pixel: 2 x 2
constexpr float kFar = 1e30F;  // footprint of a miss: every octave is faded out

std::size_t Lane(int x, int row) { return static_cast<std::size_t>(x / kSide) * kPacket + row * kSide + x % kSide; }

/// Weighs sub-samples vertically as their rows come: rows wait in a ring until a pixel row has all of its own.
class Gatherer {
 public:
  Gatherer(const Psf& psf, int samples, int width, int height)
      : psf_(psf), samples_(samples), width_(width), height_(height), ring_((2 * psf.radius_px + 1) * samples) {
    rows_.resize(static_cast<std::size_t>(ring_) * width);
    image_.reserve(static_cast<std::size_t>(width) * height);
  }

  /// Takes the next row of sub-samples: `samples` phases of width values each, value (phase, x) at x + (phase +
  /// .5)/samples.
  void AddRow(const std::vector<std::vector<float>>& phases) {
    float* row = Row(rows_seen_++);
    std::fill(row, row + width_, 0.0F);
    for (int phase = 0; phase < samples_; ++phase) {
      Pad(phases[phase]);
      for (int k = 0; k <= 2 * psf_.radius_px; ++k) {
        const float tap = psf_.taps[static_cast<std::size_t>(k) * samples_ + phase];
        const float* source = padded_.data() + k;
        for (int x = 0; x < width_; ++x) row[x] += tap * source[x];
      }
    }
    while (static_cast<int>(image_.size() / width_) < height_ &&
           rows_seen_ >= std::min(PixelRow() + psf_.radius_px + 1, height_) * samples_)
      Emit();
  }
  std::vector<float> Take() { return std::move(image_); }

 private:
  float* Row(int sub_row) { return rows_.data() + static_cast<std::size_t>(sub_row % ring_) * width_; }
  int PixelRow() const { return static_cast<int>(image_.size() / width_); }
  void Pad(const std::vector<float>& phase) {
    padded_.resize(static_cast<std::size_t>(width_) + 2 * psf_.radius_px);
    std::fill_n(padded_.begin(), psf_.radius_px, phase[0]);
    std::copy_n(phase.begin(), width_, padded_.begin() + psf_.radius_px);
    std::fill(padded_.begin() + psf_.radius_px + width_, padded_.end(), phase[width_ - 1]);
  }
  void Emit() {
    const int y = PixelRow();
    image_.resize(image_.size() + width_, 0.0F);
    float* sum = image_.data() + static_cast<std::size_t>(y) * width_;
    for (int k = 0; k < ring_; ++k) {
      const int pixel = std::clamp(y - psf_.radius_px + k / samples_, 0, height_ - 1);
      const float tap = psf_.taps[k];
      const float* source = Row(pixel * samples_ + k % samples_);
      for (int x = 0; x < width_; ++x) sum[x] += tap * source[x];
    }
  }

  const Psf& psf_;
  int samples_, width_, height_, ring_, rows_seen_ = 0;
  std::vector<float> rows_, padded_, image_;
};

}  // namespace

/// Four rows of rays in the order of the packets. With sub-samples the arrays of points hold four runs, one a
/// sub-sample.
struct ImageSampler::Strip {
  bool subs = false;
  std::size_t lanes = 0;
  std::array<std::vector<Eigen::Vector2d>, kSide> ideal;
  std::vector<float> x_m, y_m, z_m, footprint_m, texture, radiance;  // lanes * (subs ? 4 : 1)
  std::vector<float> shade, depth_m;                                 // lanes

  void Resize(std::size_t rays) {
    lanes = rays;
    for (auto* v : {&x_m, &y_m, &z_m, &footprint_m, &texture, &radiance}) v->resize(subs ? kSubs * rays : rays);
    for (auto* v : {&shade, &depth_m}) v->resize(rays);
  }
};

/// How rays stand on the surface: steps of the direction for one pixel right and down, footprint of a sample in pixels.
struct ImageSampler::Footing {
  Eigen::Vector3f right, down;
  float footprint_px = 1;
};

ImageSampler::ImageSampler(const SceneView& view, std::size_t image)
    : view_(view), rays_(view.scene.camera), kernel_(SelectNoiseKernel()) {
  const Rigid3& pose = view.scene.cam_from_world.at(image);
  world_from_cam_ = pose.rotation.conjugate().toRotationMatrix();
  center_m_ = pose.Center().cast<float>();
  light_ = Eigen::Vector3f(-0.55F, 0.60F, 0.58F).normalized();
  if (view.scene.options.surface == "relief") ambient_ = 0.10F;
  exposure_ = static_cast<float>(view.scene.exposures.at(image));
  pixel_size_ = static_cast<float>(1.0 / view.scene.camera.model.MeanFocal());
}

/// Shading is half Lambert: the cosine mapped from [-1, 1] to [0, 1] and squared, so that no terminator makes an edge.
void ImageSampler::Place(const RayPacket& packet, std::size_t first, const Footing& footing, Strip& strip) const {
  for (int i = 0; i < kPacket; ++i) {
    const std::size_t lane = first + i;
    const int subs = strip.subs ? kSubs : 1;
    if (!std::isfinite(packet.t[i])) {
      strip.shade[lane] = strip.depth_m[lane] = 0;
      for (int s = 0; s < subs; ++s) {
        const std::size_t at = s * strip.lanes + lane;
        strip.x_m[at] = strip.y_m[at] = strip.z_m[at] = 0;
        strip.footprint_m[at] = kFar;
      }
      continue;
    }
    const auto& [a, b, c] = view_.surface.triangles[packet.triangle[i]];
    const float u = packet.u[i], v = packet.v[i], t = packet.t[i];
    const auto& n = view_.surface.normals;
    const auto& p = view_.surface.vertices_m;
    const Eigen::Vector3f normal = ((1 - u - v) * n[a] + (u * n[b] + v * n[c])).normalized();
    const Eigen::Vector3f plane = (p[b] - p[a]).cross(p[c] - p[a]);
    const Eigen::Vector3f direction(packet.dx[i], packet.dy[i], packet.dz[i]);
    // The direction has Z = 1 in the camera frame, so t is the depth. A sample's footprint on the surface is base / cos
    // long and base wide: its mean axis decides, its longer one where the view grazes.
    const float length2 = direction.squaredNorm(), base = footing.footprint_px * pixel_size_ * t * std::sqrt(length2);
    const float cosine = std::max(std::abs(normal.dot(direction)) / std::sqrt(length2), 1e-3F);
    const float footprint_m = base * std::max(1 / std::sqrt(cosine), 0.6F / cosine);
    const float half = 0.5F + 0.5F * normal.dot(light_);
    strip.shade[lane] = ambient_ + (1.25F - ambient_) * half * half;
    strip.depth_m[lane] = t;
    const float along = plane.dot(direction);
    for (int s = 0; s < subs; ++s) {
      Eigen::Vector3f ray = direction;
      float reach = t;
      if (strip.subs) {
        ray += (s % 2 == 0 ? -0.25F : 0.25F) * footing.right + (s / 2 == 0 ? -0.25F : 0.25F) * footing.down;
        const float ratio = along / plane.dot(ray);  // where the ray meets the plane of the triangle
        reach *= ratio > 0.9F && ratio < 1.1F ? ratio : 1.0F;
      }
      const Eigen::Vector3f point = center_m_ + reach * ray;
      const std::size_t at = s * strip.lanes + lane;
      strip.x_m[at] = point.x(), strip.y_m[at] = point.y(), strip.z_m[at] = point.z();
      strip.footprint_m[at] = footprint_m;
    }
  }
}

float ImageSampler::Radiance(float shade, float texture) const {
  if (shade == 0) return kBackground * exposure_;
  const float s = 0.16F * texture;
  const float albedo = 0.56F + 0.42F * s / std::sqrt(1 + s * s);
  return exposure_ * shade * albedo;
}

void ImageSampler::Texture(Strip& strip) const {
  SumNoise(kernel_, view_.texture,
           {strip.x_m.data(), strip.y_m.data(), strip.z_m.data(), strip.footprint_m.data(), strip.x_m.size()},
           strip.texture.data());
  for (std::size_t run = 0; run < strip.x_m.size(); run += strip.lanes)
    for (std::size_t lane = 0; lane < strip.lanes; ++lane)
      strip.radiance[run + lane] = Radiance(strip.shade[lane], strip.texture[run + lane]);
}

/// Four rows of rays from (x, y) on, `spacing` px apart down; along the rows always one pixel apart.
void ImageSampler::Trace(double x_px, double y_px, double spacing_px, int width, Strip& strip) const {
  const int padded = (width + kSide - 1) / kSide * kSide;
  strip.Resize(static_cast<std::size_t>(padded) * kSide);
  for (int r = 0; r < kSide; ++r) rays_.Row(x_px, y_px + r * spacing_px, padded, strip.ideal[r]);
  RayPacket packet;
  Footing footing;
  footing.footprint_px = static_cast<float>(strip.subs ? 0.5 : spacing_px);
  for (int x = 0; x < padded; x += kSide) {
    for (int i = 0; i < kPacket; ++i) {
      const Eigen::Vector2d& ideal = strip.ideal[i / kSide][x + i % kSide];
      const Eigen::Vector3d direction =
          world_from_cam_.col(0) * ideal.x() + world_from_cam_.col(1) * ideal.y() + world_from_cam_.col(2);
      packet.dx[i] = static_cast<float>(direction.x()), packet.dy[i] = static_cast<float>(direction.y()),
      packet.dz[i] = static_cast<float>(direction.z());
    }
    const Eigen::Vector2d right = (strip.ideal[0][x + kSide - 1] - strip.ideal[0][x]) / (kSide - 1);
    const Eigen::Vector2d down = (strip.ideal[kSide - 1][x] - strip.ideal[0][x]) / ((kSide - 1) * spacing_px);
    footing.right = (world_from_cam_.leftCols<2>() * right).cast<float>();
    footing.down = (world_from_cam_.leftCols<2>() * down).cast<float>();
    view_.caster.Cast(center_m_, packet);
    Place(packet, static_cast<std::size_t>(x) * kSide, footing, strip);
  }
  Texture(strip);
}

/// Mean radiance of the quadrants of a pixel, from 2 x 2 rays each.
std::array<float, 4> ImageSampler::Quadrants(int x_px, int y_px) const {
  RayPacket packet;
  for (int i = 0; i < kPacket; ++i) {
    const Eigen::Vector2d ideal = rays_.At(x_px + (i % kSide + 0.5) / kSide, y_px + (i / kSide + 0.5) / kSide);
    const Eigen::Vector3f direction = (world_from_cam_ * ideal.homogeneous()).cast<float>();
    packet.dx[i] = direction.x(), packet.dy[i] = direction.y(), packet.dz[i] = direction.z();
  }
  view_.caster.Cast(center_m_, packet);
  Strip strip;
  strip.Resize(kPacket);
  Place(packet, 0, {Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero(), 0.5F}, strip);
  Texture(strip);
  std::array<float, 4> quadrants{};
  for (int i = 0; i < kPacket; ++i) quadrants[(i / kSide / 2) * 2 + i % kSide / 2] += 0.25F * strip.radiance[i];
  return quadrants;
}

/// On a plane 1 / Z is linear in the image: a second difference of more than 8 pixel sizes is an edge. `above` is the
/// depth of the row above the strip (empty at the border), `below` the next strip (null at the border).
void ImageSampler::RefineEdges(int x_px, int y_px, int width, const std::vector<float>& above, const Strip* below,
                               Strip& strip) const {
  std::array<std::vector<float>, kSide + 2> inverse;
  const auto fill = [&](std::vector<float>& row, const Strip& from, int r) {
    row.resize(width);
    for (int x = 0; x < width; ++x) {
      const float depth_m = from.depth_m[Lane(x, r)];
      row[x] = depth_m > 0 ? 1 / depth_m : 0.0F;
    }
  };
  for (int r = 0; r < kSide; ++r) fill(inverse[r + 1], strip, r);
  inverse[0] = above.empty() ? inverse[1] : above;
  if (below != nullptr) fill(inverse[kSide + 1], *below, 0);
  if (below == nullptr) inverse[kSide + 1] = inverse[kSide];
  for (int r = 0; r < kSide; ++r) {
    const auto &up = inverse[r], &row = inverse[r + 1], &next = inverse[r + 2];
    for (int x = 0; x < width; ++x) {
      const float here = row[x], left = row[std::max(x - 1, 0)], right = row[std::min(x + 1, width - 1)];
      const float bend = std::max(std::abs(2 * here - left - right), std::abs(2 * here - up[x] - next[x]));
      const float largest = std::max({here, left, right, up[x], next[x]});
      if (!(bend > 8 * pixel_size_ * largest)) continue;
      const auto quadrants = Quadrants(x_px + x, y_px + r);
      for (int s = 0; s < kSubs; ++s) strip.radiance[s * strip.lanes + Lane(x, r)] = quadrants[s];
    }
  }
}

std::vector<float> ImageSampler::Render(const Window& window, std::vector<float>* depth_m) const {
  const int width = window.width_px, height = window.height_px;
  RILIEVO_CHECK(window.x_px >= 0 && window.y_px >= 0 && width > 0 && height > 0);
  const Psf psf(view_.scene.options.blur_px, 2);
  Gatherer gatherer(psf, 2, width, height);
  std::array<Strip, 2> strips;  // the one being finished and the one below it
  for (Strip& strip : strips) strip.subs = true;
  std::vector<float> above;
  std::vector<std::vector<float>> phases(2, std::vector<float>(width));
  const int count = (height + kSide - 1) / kSide;
  Trace(window.x_px + 0.5, window.y_px + 0.5, 1, width, strips[0]);
  for (int k = 0; k < count; ++k) {
    Strip& strip = strips[k % 2];
    Strip* below = k + 1 < count ? &strips[(k + 1) % 2] : nullptr;
    if (below != nullptr) Trace(window.x_px + 0.5, window.y_px + (k + 1) * kSide + 0.5, 1, width, *below);
    RefineEdges(window.x_px, window.y_px + k * kSide, width, above, below, strip);
    above.resize(width);
    for (int x = 0; x < width; ++x) {
      const float last_m = strip.depth_m[Lane(x, kSide - 1)];
      above[x] = last_m > 0 ? 1 / last_m : 0.0F;
    }
    for (int r = 0; r < kSide && k * kSide + r < height; ++r) {
      for (int s = 0; s < 2; ++s) {
        for (int phase = 0; phase < 2; ++phase)
          for (int x = 0; x < width; ++x) phases[phase][x] = strip.radiance[(2 * s + phase) * strip.lanes + Lane(x, r)];
        gatherer.AddRow(phases);
      }
      for (int x = 0; depth_m != nullptr && x < width; ++x) depth_m->push_back(strip.depth_m[Lane(x, r)]);
    }
  }
  return gatherer.Take();
}

std::vector<float> ImageSampler::RenderReference(const Window& window, int samples) const {
  const int width = window.width_px, height = window.height_px;
  RILIEVO_CHECK(window.x_px >= 0 && window.y_px >= 0 && width > 0 && height > 0 && samples % kSide == 0);
  const Psf psf(view_.scene.options.blur_px, samples);
  Gatherer gatherer(psf, samples, width, height);
  std::vector<Strip> strips(samples);  // one a phase along the rows
  const double step_px = 1.0 / samples;
  for (int row = 0; row < height * samples; row += kSide) {
    for (int phase = 0; phase < samples; ++phase)
      Trace(window.x_px + (phase + 0.5) * step_px, window.y_px + (row + 0.5) * step_px, step_px, width, strips[phase]);
    std::vector<std::vector<float>> phases(samples, std::vector<float>(width));
    for (int r = 0; r < kSide; ++r) {
      for (int phase = 0; phase < samples; ++phase)
        for (int x = 0; x < width; ++x) phases[phase][x] = strips[phase].radiance[Lane(x, r)];
      gatherer.AddRow(phases);
    }
  }
  return gatherer.Take();
}

}  // namespace rilievo::simulation
