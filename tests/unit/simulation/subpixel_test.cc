// The renderer's own sub-pixel error: one ray a pixel against a converged reference, and view against view.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>

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
      const Eigen::Vector4d row(-0.5 * (mean(x + 1, y) - mean(x - 1, y)), -0.5 * (mean(x, y + 1) - mean(x, y - 1)), mean(x, y), 1);
      normal += row * row.transpose();
      right += row * (moved.At(x, y) - reference.At(x, y));
    }
  return normal.ldlt().solve(right).head<2>();
}

TEST(SubPixel, TheEstimatorFindsAKnownShift) {
  // Witness for the tests below: a smooth function sampled at a known distance.
  const Eigen::Vector2d shift(0.037, -0.052);
  Patch reference{31, {}}, moved{31, {}};
  const auto f = [](double x, double y) { return std::sin(0.5 * x + 0.2 * y) + std::cos(0.31 * y - 0.17 * x) + 0.5 * std::sin(0.8 * y); };
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
    const Window window{static_cast<int>(rng.Below(options.width_px - size)), static_cast<int>(rng.Below(options.height_px - size)), size, size};
    bool full = true;  // a patch of background has no displacement
    for (const double x : {0.0, 0.5, 1.0})
      for (const double y : {0.0, 0.5, 1.0})
        full = full && renderer.SurfacePoint(image, {window.x_px + x * size, window.y_px + y * size}).has_value();
    if (!full) continue;
    const Eigen::Vector2d d = Displacement(RenderPatch(renderer, image, window, 1), RenderPatch(renderer, image, window, samples));
    squares += d.squaredNorm() / 2;
    ++used;
  }
  return std::sqrt(squares / count);
}

TEST(SubPixel, OneRayAPixelAgreesWithAManyRayReference) {
  const double relief = RmsAgainstReference(CleanOptions(), 60, 31, 12);
  RecordProperty("relief_rms_px", std::to_string(relief));
  std::printf("relief %.4f px RMS a coordinate\n", relief);
  EXPECT_LT(relief, 0.02);
  SceneOptions sphere = CleanOptions();
  sphere.surface = "sphere";
  const double closed = RmsAgainstReference(sphere, 60, 31, 12);
  std::printf("sphere %.4f px RMS a coordinate\n", closed);
  EXPECT_LT(closed, 0.02);
}

}  // namespace
}  // namespace rilievo::simulation
