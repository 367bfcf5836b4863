// Rendered pixels, depth and exact queries tell one story, always the same.
#include "simulation/renderer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <thread>

#include "base/rng.h"
#include "simulation/scene_source.h"

namespace rilievo::simulation {
namespace {

SceneOptions Small(const std::string& surface) {
  SceneOptions options;
  options.surface = surface;
  options.images = 4;
  options.width_px = 323;  // no multiple of the packets' side
  options.height_px = 217;
  options.surface_points = 20000;
  return options;
}

TEST(Renderer, GivesTheSameBytesInEveryThreadAndRenderer) {
  for (const char* surface : {"relief", "statue"}) {
    const Scene scene = MakeScene(Small(surface));
    const Renderer renderer(scene), again(scene);
    const GreyImage expected = renderer.RenderGrey(1);
    std::vector<GreyImage> images(4);
    std::vector<std::thread> threads;
    for (std::size_t i = 0; i < images.size(); ++i)
      threads.emplace_back([&, i] { images[i] = (i % 2 == 0 ? renderer : again).RenderGrey(1); });
    for (auto& thread : threads) thread.join();
    for (const auto& image : images) EXPECT_EQ(image.u8, expected.u8);
    EXPECT_NE(renderer.RenderGrey(2).u8, expected.u8);
  }
}

TEST(Renderer, AWindowShowsWhatTheImageShows) {
  SceneOptions options = Small("sphere");
  options.noise = 0;
  const Renderer renderer(MakeScene(options));
  const GreyImage image = renderer.RenderGrey(0);
  const Window window{97, 58, 120, 101};
  const auto radiance = renderer.RenderRadiance(0, window, 1);
  for (int y = 0; y < window.height_px; ++y)
    for (int x = 0; x < window.width_px; ++x)
      ASSERT_NEAR(255 * radiance[y * window.width_px + x], image.u8[(window.y_px + y) * 323 + window.x_px + x],
                  0.51 + 1e-3);
}

TEST(Renderer, AClosedObjectHasContrastAllAround) {
  for (const char* surface : {"sphere", "statue"}) {
    SceneOptions options = Small(surface);
    options.network = "ring";
    options.images = 8;
    options.noise = 0;
    options.exposure_spread = 0;
    const Renderer renderer(MakeScene(options));
    double least = 1e9, most = 0;
    for (std::size_t i = 0; i < 8; ++i) {
      const auto radiance = renderer.RenderRadiance(i, {141, 88, 40, 40}, 1);  // inside the object
      double sum = 0, squares = 0;
      for (const float value : radiance) sum += value, squares += value * value;
      const double mean = sum / 1600, deviation = std::sqrt(squares / 1600 - mean * mean);
      least = std::min(least, deviation), most = std::max(most, deviation);
    }
    EXPECT_GT(least, 0.03) << surface << ": six times the default noise";
    EXPECT_LT(most, 4 * least) << surface;
  }
}

TEST(Renderer, DepthEqualsTheExactRay) {
  for (const char* surface : {"relief", "sphere", "statue"}) {
    const Renderer renderer(MakeScene(Small(surface)));
    const DepthImage depth = renderer.RenderDepth(2);
    ASSERT_EQ(depth.depth_m.size(), 323U * 217U);
    int hits = 0;
    for (int y = 0; y < 217; y += 3)
      for (int x = 0; x < 323; x += 3) {
        const auto point = renderer.SurfacePoint(2, {x + 0.5, y + 0.5});
        const float seen_m = depth.depth_m[y * 323 + x];
        ASSERT_EQ(point.has_value(), seen_m > 0);
        if (!point) continue;
        ASSERT_NEAR((renderer.scene().cam_from_world[2] * *point).z(), seen_m, 2e-5);
        ++hits;
      }
    EXPECT_GT(hits, std::string(surface) == "relief" ? 7800 : 500);
  }
}

TEST(Renderer, AReliefFillsEveryImage) {
  for (const char* network : {"arc", "strip", "ring", "random"}) {
    SceneOptions options = Small("relief");
    options.network = network;
    const Renderer renderer(MakeScene(options));
    for (std::size_t i = 0; i < 4; ++i)
      for (const float z : renderer.RenderDepth(i).depth_m) ASSERT_GT(z, 0) << network << " image " << i;
  }
}

TEST(Renderer, SurfacePointsProjectBackAndAreVisible) {
  const Renderer renderer(MakeScene(Small("statue")));
  Rng rng(1);
  int visible_elsewhere = 0, hidden = 0;
  for (int k = 0; k < 3000; ++k) {
    const Eigen::Vector2d pixel(rng.Uniform(0, 323), rng.Uniform(0, 217));
    const auto point = renderer.SurfacePoint(0, pixel);
    if (!point) continue;
    ASSERT_LT((*renderer.Project(0, *point) - pixel).norm(), 1e-8);
    ASSERT_TRUE(renderer.Visible(*point, 0));
    ASSERT_LT((*renderer.ClosestPoint(*point, 1.0) - *point).norm(), 1e-6);
    (renderer.Visible(*point, 3) ? visible_elsewhere : hidden)++;
    // The far side of the body is hidden by the near one.
    const Eigen::Vector3d behind = *point + 1.2 * (*point - renderer.scene().cam_from_world[0].Center()).normalized();
    ASSERT_FALSE(renderer.Visible(behind, 0));
  }
  EXPECT_GT(visible_elsewhere, 100);
  EXPECT_GT(hidden, 10);
}

TEST(Renderer, NearestPointIsNoFartherThanAnyVertexOrRayHit) {
  const Renderer renderer(MakeScene(Small("sphere")));
  Rng rng(8);
  for (int k = 0; k < 50; ++k) {
    const Eigen::Vector3d query(rng.Uniform(-2, 2), rng.Uniform(-2, 2), rng.Uniform(-2, 2));
    const double distance_m = (*renderer.ClosestPoint(query, 100) - query).norm();
    double nearest_vertex_m = 1e9;
    for (const auto& v : renderer.surface().vertices_m)
      nearest_vertex_m = std::min(nearest_vertex_m, (v.cast<double>() - query).norm());
    ASSERT_LE(distance_m, nearest_vertex_m + 1e-7);
    ASSERT_GT(distance_m, nearest_vertex_m - 0.05);  // a mesh cell
    ASSERT_FALSE(renderer.ClosestPoint(query, 0.9 * distance_m));
  }
}

TEST(Renderer, PixelsStandWhereTheGeometrySaysAtASilhouette) {
  // Total light is the same as that of the exact coverage: the sphere's area in pixels, from many exact rays.
  SceneOptions options = Small("sphere");
  options.noise = 0, options.vignetting = 0, options.exposure_spread = 0, options.blur_px = 0;
  const Renderer renderer(MakeScene(options));
  const Window whole{0, 0, 323, 217};
  const auto image = renderer.RenderRadiance(0, whole, 1), reference = renderer.RenderRadiance(0, whole, 8);
  double sum = 0, expected = 0, worst = 0;
  for (std::size_t i = 0; i < image.size(); ++i) {
    sum += image[i], expected += reference[i];
    worst = std::max(worst, static_cast<double>(std::abs(image[i] - reference[i])));
  }
  EXPECT_NEAR(sum / expected, 1, 1e-3);
  EXPECT_LT(worst, 0.12);  // an eighth of coverage at most: 4 x 4 rays against 8 x 8
}

TEST(Renderer, NoiseHasTheStatedDeviation) {
  SceneOptions options = Small("relief");
  options.bits = "16", options.format = "tif", options.noise = 0.01;
  SceneOptions clean = options;
  clean.noise = 0;
  const GreyImage noisy = Renderer(MakeScene(options)).RenderGrey(0), quiet = Renderer(MakeScene(clean)).RenderGrey(0);
  ASSERT_TRUE(noisy.Is16Bit());
  double sum = 0, squares = 0, neighbours = 0, before = 0;
  for (std::size_t i = 0; i < noisy.u16.size(); ++i) {
    const double d = (static_cast<double>(noisy.u16[i]) - quiet.u16[i]) / 65535;
    sum += d, squares += d * d, neighbours += d * before;
    before = d;
  }
  const double n = static_cast<double>(noisy.u16.size());
  EXPECT_NEAR(sum / n, 0, 2e-4);
  EXPECT_NEAR(std::sqrt(squares / n), 0.01, 2e-4);
  EXPECT_NEAR(neighbours / squares, 0, 0.02);
}

TEST(ScenePixelSource, RendersByName) {
  const auto renderer = std::make_shared<const Renderer>(MakeScene(Small("relief")));
  const ScenePixelSource source(renderer);
  const GreyImage image = source.Load("image_0003.jpg", true);
  EXPECT_EQ(image.u8, renderer->RenderGrey(2).u8);
  ASSERT_EQ(image.rgb.size(), 3 * image.u8.size());
  EXPECT_EQ(image.rgb[301], image.u8[100]);
  EXPECT_THROW(source.Load("image_0099.jpg", false), Error);
  const Block block = SceneBlock(renderer->scene());
  ASSERT_EQ(block.images.size(), 4U);
  EXPECT_NE(block.images[0].content, block.images[1].content);
  EXPECT_EQ(block.camera_of(ImageId(3)).width_px, 323);
}

TEST(RenderBytes, CoverThePixelsAndTheSurface) {
  const Scene scene = MakeScene(Small("relief"));
  const SurfaceSize planned = PlannedSurfaceSize(scene);
  const Surface surface = MakeSurface(scene);
  EXPECT_EQ(planned.vertices, surface.vertices_m.size());
  EXPECT_EQ(planned.triangles, surface.triangles.size());
  EXPECT_NEAR(static_cast<double>(planned.vertices), 20000, 500);
  EXPECT_GT(EstimateRenderBytes(scene).per_image, 323U * 217U * 9U);
}

}  // namespace
}  // namespace rilievo::simulation
