// The parts of robust estimation: solvers a sample, residuals a block of 64 pairs, sums of a refinement a pair.
#include <benchmark/benchmark.h>

#include <vector>

#include "geometry/pair_arrays.h"
#include "geometry/robust/two_view_problems.h"
#include "geometry/solvers/homography.h"
#include "geometry/solvers/seven_point.h"
#include "tests/support/two_view_scenes.h"

namespace rilievo {
namespace {

TwoViewScene Scene(std::size_t points, double outliers) {
  Rng rng(7);
  return MakeTwoViewScene(rng, {.points = points, .outlier_share = outliers, .noise = 2e-4});
}

/// Kernels by their place in AllTwoViewKernels; skipped where this processor lacks them.
const TwoViewKernels* KernelsOf(benchmark::State& state) {
  const TwoViewKernels& kernels = AllTwoViewKernels()[static_cast<std::size_t>(state.range(0))];
  state.SetLabel(std::string(kernels.name));
  if (kernels.is_supported) return &kernels;
  state.SkipWithError("not supported by this processor");
  return nullptr;
}

void FivePointSample(benchmark::State& state) {
  const TwoViewKernels* kernels = KernelsOf(state);
  if (kernels == nullptr) return;
  const TwoViewScene scene = Scene(5 * kFivePointBatch * 16, 0.5);
  std::vector<FivePointSamples> batches(16);
  std::size_t next = 0;
  for (FivePointSamples& batch : batches) {
    for (int lane = 0; lane < kFivePointBatch; ++lane) {
      for (int i = 0; i < 5; ++i, ++next) {
        batch.rows[i][lane] = scene.first[next].x();
        batch.rows[5 + i][lane] = scene.first[next].y();
        batch.rows[10 + i][lane] = scene.second[next].x();
        batch.rows[15 + i][lane] = scene.second[next].y();
      }
    }
  }
  FivePointModels models;
  std::size_t batch = 0;
  for (auto _ : state) {
    kernels->five_point_oriented(batches[batch++ % batches.size()], models);
    benchmark::DoNotOptimize(models);
  }
  state.SetItemsProcessed(state.iterations() * kFivePointBatch);
}
BENCHMARK(FivePointSample)->DenseRange(0, 2);

void SampsonBlock(benchmark::State& state) {
  const TwoViewKernels* kernels = KernelsOf(state);
  if (kernels == nullptr) return;
  const TwoViewScene scene = Scene(kPairBlock, 0);
  const PointPairs pairs(scene.first, scene.second, {});
  const float matrix[9] = {0.1F, 0.2F, 0.3F, -0.1F, 0.4F, 0.1F, 0.5F, -0.2F, 0.3F};
  float squared[kPairBlock];
  for (auto _ : state) {
    kernels->sampson(matrix, 1, 1, pairs.BlockAt(0), squared);
    benchmark::DoNotOptimize(kernels->truncate(squared, kPairBlock, 1));
  }
  state.SetItemsProcessed(state.iterations() * kPairBlock);
}
BENCHMARK(SampsonBlock)->DenseRange(0, 2);

void SampsonSums(benchmark::State& state) {
  const TwoViewKernels* kernels = KernelsOf(state);
  if (kernels == nullptr) return;
  const TwoViewScene scene = Scene(400, 0);
  const PairArrays pairs(scene.first, scene.second);
  const double matrix[9] = {0.1, 0.2, 0.3, -0.1, 0.4, 0.1, 0.5, -0.2, 0.3};
  MatrixSums sums;
  for (auto _ : state) {
    kernels->sampson_sums(matrix, 1, 1, pairs.Columns(), sums);
    benchmark::DoNotOptimize(sums);
  }
  state.SetItemsProcessed(state.iterations() * 400);
}
BENCHMARK(SampsonSums)->DenseRange(0, 2);

template <std::size_t kSize>
std::array<std::array<Eigen::Vector3d, kSize>, 2> SampleOf(const TwoViewScene& scene) {
  std::array<std::array<Eigen::Vector3d, kSize>, 2> sample;
  for (std::size_t i = 0; i < kSize; ++i) {
    sample[0][i] = scene.first[i].homogeneous();
    sample[1][i] = scene.second[i].homogeneous();
  }
  return sample;
}

void SevenPointSample(benchmark::State& state) {
  const auto [first, second] = SampleOf<7>(Scene(7, 0));
  for (auto _ : state) benchmark::DoNotOptimize(SolveSevenPoint(first, second));
}
BENCHMARK(SevenPointSample);

void FourPointSample(benchmark::State& state) {
  const auto [first, second] = SampleOf<4>(Scene(4, 0));
  for (auto _ : state) benchmark::DoNotOptimize(SolveHomographyFourPoint(first, second));
}
BENCHMARK(FourPointSample);

}  // namespace
}  // namespace rilievo
