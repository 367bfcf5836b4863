// The renderer's own sub-pixel error: one ray a pixel against a converged reference, and view against view.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <array>
#include <cmath>

#include "base/rng.h"
#include "simulation/renderer.h"

namespace rilievo::simulation {
namespace {

SceneOptions CleanOptions() {
  SceneOptions options;
  options.images = 3;
  options.width_px = 1500;
  options.height_px = 1000;
  options.noise = 0;
  options.vignetting = 0;
  options.exposure_spread = 0;
  options.surface_points = 60000;
  return options;
}

struct Patch {
  int size = 0;
  std::vector<float> values;
  double At(int x, int y) const { return values[static_cast<std::size_t>(y) * size + x]; }
};

Patch RenderPatch(const Renderer& renderer, std::size_t image, const Window& window, int samples) {
  return {window.width_px, renderer.RenderRadiance(image, window, samples)};
}

/// Displacement d with moved(x) = gain * reference(x - d) + offset by least squares (Lucas & Kanade 1981) about the
/// symmetric point, so that reference and moved play the same part: gradients of both are averaged. Small shifts only.
Eigen::Vector2d Displacement(const Patch& moved, const Patch& reference) {
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  Eigen::Vector4d right = Eigen::Vector4d::Zero();
  const auto mean = [&](int x, int y) { return 0.5 * (moved.At(x, y) + reference.At(x, y)); };
  for (int y = 1; y + 1 < reference.size; ++y)
    for (int x = 1; x + 1 < reference.size; ++x) {
      const Eigen::Vector4d row(-0.5 * (mean(x + 1, y) - mean(x - 1, y)), -0.5 * (mean(x, y + 1) - mean(x, y - 1)),
                                mean(x, y), 1);
      normal += row * row.transpose();
      right += row * (moved.At(x, y) - reference.At(x, y));
    }
  return normal.ldlt().solve(right).head<2>();
}

TEST(SubPixel, TheEstimatorFindsAKnownShift) {
  // Witness for the tests below: a smooth function sampled at a known distance.
  const Eigen::Vector2d shift(0.037, -0.052);
  Patch reference{31, {}}, moved{31, {}};
  const auto f = [](double x, double y) {
    return std::sin(0.5 * x + 0.2 * y) + std::cos(0.31 * y - 0.17 * x) + 0.5 * std::sin(0.8 * y);
  };
  for (int y = 0; y < 31; ++y)
    for (int x = 0; x < 31; ++x) {
      reference.values.push_back(static_cast<float>(f(x, y)));
      moved.values.push_back(static_cast<float>(0.9 * f(x - shift.x(), y - shift.y()) + 0.1));
    }
  EXPECT_LT((Displacement(moved, reference) - shift).norm(), 0.006);
}

double RmsAgainstReference(const SceneOptions& options, int count, int size, int samples) {
  const Renderer renderer(MakeScene(options));
  Rng rng(99);
  double squares = 0;
  int used = 0;
  while (used < count) {
    const auto image = rng.Below(static_cast<std::uint32_t>(options.images));
    const Window window{static_cast<int>(rng.Below(options.width_px - size)),
                        static_cast<int>(rng.Below(options.height_px - size)), size, size};
    bool full = true;  // a patch of background has no displacement
    for (const double x : {0.0, 0.5, 1.0})
      for (const double y : {0.0, 0.5, 1.0})
        full = full && renderer.SurfacePoint(image, {window.x_px + x * size, window.y_px + y * size}).has_value();
    if (!full) continue;
    const Eigen::Vector2d d =
        Displacement(RenderPatch(renderer, image, window, 1), RenderPatch(renderer, image, window, samples));
    squares += d.squaredNorm() / 2;
    ++used;
  }
  return std::sqrt(squares / count);
}

TEST(SubPixel, OneRayAPixelAgreesWithAManyRayReference) {
  EXPECT_LT(RmsAgainstReference(CleanOptions(), 60, 31, 12), 0.02);
  SceneOptions sphere = CleanOptions();
  sphere.surface = "sphere";
  EXPECT_LT(RmsAgainstReference(sphere, 60, 31, 12), 0.02);
  SceneOptions sharp = CleanOptions();
  sharp.blur_px = 0;
  EXPECT_LT(RmsAgainstReference(sharp, 60, 31, 12), 0.02);
}

/// Catmull-Rom interpolation at (x, y) in units of the patch's pixel indices.
double Cubic(const Patch& patch, double x, double y) {
  const int ix = static_cast<int>(std::floor(x)), iy = static_cast<int>(std::floor(y));
  const auto weights = [](double t) {
    return std::array<double, 4>{0.5 * t * (t * (2 - t) - 1), 0.5 * (t * t * (3 * t - 5) + 2),
                                 0.5 * t * (t * (4 - 3 * t) + 1), 0.5 * t * t * (t - 1)};
  };
  const auto wx = weights(x - ix), wy = weights(y - iy);
  double sum = 0;
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 4; ++i) sum += wx[i] * wy[j] * patch.At(ix + i - 1, iy + j - 1);
  return sum;
}

TEST(SubPixel, TwoViewsAgreeThroughTheExactGeometry) {
  // Each pixel of a patch of view 0 is looked up in view 1 where its surface point projects to; what is left of a shift
  // is the renderer's error and the interpolation's.
  const Renderer renderer(MakeScene(CleanOptions()));
  constexpr int kSize = 31, kLarge = 80;
  Rng rng(5);
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  double squares = 0;
  int count = 0;
  for (int attempt = 0; attempt < 2000 && count < 60; ++attempt) {
    const Window window{static_cast<int>(rng.Below(1500 - kSize)), static_cast<int>(rng.Below(1000 - kSize)), kSize,
                        kSize};
    const auto middle = renderer.SurfacePoint(0, {window.x_px + 0.5 * kSize, window.y_px + 0.5 * kSize});
    const auto there = middle ? renderer.Project(1, *middle) : std::nullopt;
    if (!there) continue;
    const Window large{static_cast<int>(there->x()) - kLarge / 2, static_cast<int>(there->y()) - kLarge / 2, kLarge,
                       kLarge};
    if (large.x_px < 0 || large.y_px < 0 || large.x_px + kLarge > 1500 || large.y_px + kLarge > 1000) continue;
    const Patch second = RenderPatch(renderer, 1, large, 1), first = RenderPatch(renderer, 0, window, 1);
    Patch warped{kSize, {}};
    for (int y = 0; y < kSize; ++y)
      for (int x = 0; x < kSize; ++x) {
        const auto point = renderer.SurfacePoint(0, {window.x_px + x + 0.5, window.y_px + y + 0.5});
        if (!point || !renderer.Visible(*point, 1)) break;
        const Eigen::Vector2d at = *renderer.Project(1, *point) - Eigen::Vector2d(large.x_px + 0.5, large.y_px + 0.5);
        if (at.minCoeff() < 1 || at.maxCoeff() > kLarge - 3) break;
        warped.values.push_back(static_cast<float>(Cubic(second, at.x(), at.y())));
      }
    if (warped.values.size() != kSize * kSize) continue;
    const Eigen::Vector2d d = Displacement(warped, first);
    mean += d;
    squares += d.squaredNorm() / 2;
    ++count;
  }
  ASSERT_EQ(count, 60);
  RecordProperty("rms_px", std::to_string(std::sqrt(squares / count)));
  EXPECT_LT((mean / count).cwiseAbs().maxCoeff(), 0.01) << "a shift common to all patches is an error of geometry";
  EXPECT_LT(std::sqrt(squares / count), 0.03);
}

}  // namespace
}  // namespace rilievo::simulation
