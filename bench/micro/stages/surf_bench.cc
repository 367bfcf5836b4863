// SURF on a photograph (RILIEVO_BENCH_IMAGE, or a synthetic texture of 6 Mpx): detection alone, detection and
// description, by every kernel; counters "s/Mpx" (CPU) and "features".
#include <benchmark/benchmark.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "base/rng.h"
#include "stages/features/surf.h"
#include "stages/features/surf_kernels.h"
#include "stages/images/decode.h"

namespace rilievo::features {
namespace {

/// Smoothed noise of several sizes: as many features a megapixel as a photograph of masonry has.
GreyImage Texture() {
  GreyImage image;
  image.width_px = 3072;
  image.height_px = 2048;
  const auto noise = [](std::uint64_t seed, int x, int y, int size) {
    const double u = static_cast<double>(x) / size, v = static_cast<double>(y) / size;
    const int i = static_cast<int>(u), j = static_cast<int>(v);
    const auto at = [&](int a, int b) { return static_cast<double>(SeedFor(seed, i + a, j + b) >> 56); };
    const double s = u - i, t = v - j;
    return (1 - t) * ((1 - s) * at(0, 0) + s * at(1, 0)) + t * ((1 - s) * at(0, 1) + s * at(1, 1));
  };
  for (int y = 0; y < image.height_px; ++y) {
    for (int x = 0; x < image.width_px; ++x)
      image.u8.push_back(static_cast<std::uint8_t>(
          0.25 * (noise(1, x, y, 19) + noise(2, x, y, 31) + noise(3, x, y, 61) + noise(4, x, y, 101))));
  }
  return image;
}

const GreyImage& Image() {
  static const GreyImage image = [] {
    const char* path = std::getenv("RILIEVO_BENCH_IMAGE");
    if (path == nullptr) return Texture();
    const std::filesystem::path file(path);
    return images::FolderPixelSource(file.parent_path()).Load(file.filename().string(), false);
  }();
  return image;
}

void Surf(benchmark::State& state, const SurfKernels& kernels, const SurfOptions& options) {
  const GreyImage& image = Image();
  SerialRunContext context;
  std::size_t features = 0;
  for (auto _ : state)
    features = DetectSurf({.image = image}, options, {.strip_width_px = 1024}, context, kernels).size();
  const double mpx = 1e-6 * static_cast<double>(image.width_px) * static_cast<double>(image.height_px);
  state.counters["features"] = static_cast<double>(features);
  state.counters["s/Mpx"] =
      benchmark::Counter(mpx, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

const bool kRegistered = [] {
  for (const SurfKernels& kernels : AllSurfKernels()) {
    if (!kernels.is_supported) continue;
    const auto add = [&](const std::string& what, const SurfOptions& options) {
      benchmark::RegisterBenchmark(("surf/" + what + "/" + std::string(kernels.name)).c_str(), Surf, kernels, options)
          ->Unit(benchmark::kMillisecond);
    };
    add("detect_only", {.hessian_threshold = 1e9});
    add("128", {});
    add("64", {.elements = 64});
    add("upright_64", {.elements = 64, .upright = true});
  }
  return true;
}();

}  // namespace
}  // namespace rilievo::features
