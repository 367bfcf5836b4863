// Two nearest neighbours of 8192 x 8192 and 40960 x 8192 descriptors by every kernel, beside the peak of its
// multiply-add instruction measured in the same run: counter "GMAC/s" of both, their ratio is the share of peak.
#include <benchmark/benchmark.h>

#include <cmath>
#include <string>

#include "base/rng.h"
#include "engine/peak_loops.h"
#include "stages/matching/two_nearest.h"

namespace rilievo::matching {
namespace {

std::vector<Descriptor> RandomSift(std::size_t count, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<Descriptor> result(count);
  for (auto& descriptor : result) {
    std::array<double, 128> values{};
    double norm_sq = 0;
    for (double& v : values) {
      v = std::abs(rng.Normal());
      norm_sq += v * v;
    }
    for (std::size_t k = 0; k < 128; ++k) {
      descriptor[k] = static_cast<std::uint8_t>(std::min(255.0, std::round(512 * values[k] / std::sqrt(norm_sq))));
    }
  }
  return result;
}

void SetRate(benchmark::State& state, double products_each) {
  state.counters["GMAC/s"] = benchmark::Counter(1e-9 * products_each, benchmark::Counter::kIsIterationInvariantRate);
}

void TwoNearest(benchmark::State& state, const Kernel& kernel) {
  const auto a = RandomSift(static_cast<std::size_t>(state.range(0)), 1),
             b = RandomSift(static_cast<std::size_t>(state.range(1)), 2);
  const SerialRunContext context;
  const Prepared prepared_a = Prepare(a, kernel), prepared_b = Prepare(b, kernel);
  for (auto _ : state) benchmark::DoNotOptimize(FindTwoNearest(prepared_a, prepared_b, context));
  SetRate(state, 128.0 * static_cast<double>(a.size() * b.size()));
}

void Peak(benchmark::State& state, const engine::PeakLoop& loop) {
  for (auto _ : state) loop.run();
  SetRate(state, loop.products);
}

/// Registers what this processor can run; the work happens in the static's initialiser because the main function is the
/// library's.
const bool kRegistered = [] {
  for (const Kernel& kernel : AllKernels()) {
    if (!kernel.is_supported) continue;
    const std::string name(kernel.name);
    benchmark::RegisterBenchmark(("two_nearest/" + name).c_str(), TwoNearest, kernel)
        ->Args({8192, 8192})
        ->Args({40960, 8192})
        ->Unit(benchmark::kMillisecond);
    if (name == "avx2")
      benchmark::RegisterBenchmark("peak/avx2", Peak, engine::kPeakAvx2)->Unit(benchmark::kMillisecond);
    if (name == "avx512")
      benchmark::RegisterBenchmark("peak/avx512", Peak, engine::kPeakAvx512)->Unit(benchmark::kMillisecond);
  }
  return true;
}();

}  // namespace
}  // namespace rilievo::matching
