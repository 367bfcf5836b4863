// The noise kernels agree byte for byte, and the noise is what the texture relies on.
#include "simulation/noise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "base/rng.h"

namespace rilievo::simulation {
namespace {

struct Cloud {
  std::vector<float> x, y, z, footprint;
  NoisePoints View() const { return {x.data(), y.data(), z.data(), footprint.data(), x.size()}; }
};

Cloud RandomCloud(std::size_t count, double reach_m, double max_footprint_m) {
  Rng rng(3);
  Cloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    for (auto* axis : {&cloud.x, &cloud.y, &cloud.z})
      axis->push_back(static_cast<float>(rng.Uniform(-reach_m, reach_m)));
    cloud.footprint.push_back(static_cast<float>(rng.Uniform(0, max_footprint_m)));
  }
  return cloud;
}

TEST(Noise, KernelsGiveTheSameBytes) {
  const auto octaves = MakeOctaves({0.7, 1.93, 1.0, 0.92, 16}, 11);
  const Cloud cloud = RandomCloud(10007, 5, 0.01);  // a prime: every kernel has a tail
  std::vector<float> expected(cloud.x.size()), got(cloud.x.size());
  SumNoise(NoiseKernel::kScalar, octaves, cloud.View(), expected.data());
  for (const NoiseKernel kernel : {NoiseKernel::kAvx2, NoiseKernel::kAvx512}) {
    if (!NoiseKernelAvailable(kernel)) continue;
    SumNoise(kernel, octaves, cloud.View(), got.data());
    EXPECT_EQ(std::memcmp(expected.data(), got.data(), expected.size() * sizeof(float)), 0);
  }
}

TEST(Noise, AnOctaveHasUnitDeviationAndNoMean) {
  const auto octaves = MakeOctaves({0.05, 2, 1.0, 1.0, 1}, 4);
  const Cloud cloud = RandomCloud(200000, 10, 0);
  std::vector<float> values(cloud.x.size());
  SumNoise(SelectNoiseKernel(), octaves, cloud.View(), values.data());
  double sum = 0, squares = 0;
  for (const float v : values) sum += v, squares += v * v;
  EXPECT_NEAR(sum / values.size(), 0, 0.02);
  EXPECT_NEAR(std::sqrt(squares / values.size()), 1, 0.05);
}

TEST(Noise, IsContinuousAcrossLatticeCells) {
  const auto octaves = MakeOctaves({1.0, 2, 1.0, 1.0, 1}, 4);
  Cloud cloud;
  for (int i = 0; i < 200000; ++i) {
    cloud.x.push_back(static_cast<float>(-10 + i * 1e-4));
    cloud.y.push_back(0.3F), cloud.z.push_back(-0.7F), cloud.footprint.push_back(0);
  }
  std::vector<float> values(cloud.x.size());
  SumNoise(SelectNoiseKernel(), octaves, cloud.View(), values.data());
  for (std::size_t i = 1; i < values.size(); ++i) ASSERT_LT(std::abs(values[i] - values[i - 1]), 2e-3);
}

TEST(Noise, OctavesBeyondTheSamplingLimitAreGone) {
  const auto octaves = MakeOctaves({0.01, 2, 1.0, 1.0, 5}, 4);
  Cloud cloud = RandomCloud(1000, 1, 0);
  for (float& f : cloud.footprint) f = 0.0091F;
  std::vector<float> values(cloud.x.size());
  SumNoise(SelectNoiseKernel(), octaves, cloud.View(), values.data());
  for (const float v : values) EXPECT_EQ(v, 0.0F);
}

}  // namespace
}  // namespace rilievo::simulation
