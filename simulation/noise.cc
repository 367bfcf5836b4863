// Octave tables, the reference kernel and the choice of kernel.
#include "simulation/noise.h"

#include <Eigen/Geometry>
#include <cmath>
#include <cstdlib>
#include <string_view>

#include "base/rng.h"
#include "simulation/noise_kernel.h"

namespace rilievo::simulation {

std::vector<NoiseOctave> MakeOctaves(const OctaveRange& range, std::uint64_t seed) {
  std::vector<NoiseOctave> octaves;
  double cell_m = range.first_cell_m, amplitude = range.first_amplitude;
  for (int k = 0; k < range.count; ++k, cell_m /= range.lacunarity, amplitude *= range.persistence) {
    Rng rng(SeedFor(seed, k));
    const Eigen::Vector3d axis(rng.Normal(), rng.Normal(), rng.Normal());
    const Eigen::Matrix3d turn = Eigen::AngleAxisd(rng.Uniform(0.4, 2.7), axis.normalized()).toRotationMatrix();
    NoiseOctave octave;
    for (int i = 0; i < 9; ++i) octave.rotation[i] = static_cast<float>(turn(i / 3, i % 3) / cell_m);
    for (float& offset : octave.offset) offset = static_cast<float>(rng.Uniform());
    octave.frequency_per_m = static_cast<float>(1.0 / cell_m);
    octave.amplitude = static_cast<float>(amplitude);
    octave.seed = static_cast<std::uint32_t>(rng.Next());
    octaves.push_back(octave);
  }
  return octaves;
}

void SumNoiseScalar(std::span<const NoiseOctave> octaves, const NoisePoints& points, float* values) {
  NoiseSum<4>::Run(octaves, points, values);
}

bool NoiseKernelAvailable(NoiseKernel kernel) {
#if defined(__x86_64__)
  const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  if (kernel == NoiseKernel::kAvx2) return avx2;
  if (kernel == NoiseKernel::kAvx512)
    return avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
           __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
           __builtin_cpu_supports("avx512vnni");
#endif
  return kernel == NoiseKernel::kScalar;
}

NoiseKernel SelectNoiseKernel() {
  const char* forced = std::getenv("RILIEVO_KERNELS");
  const std::string_view name = forced != nullptr ? forced : "";
  if (name == "scalar") return NoiseKernel::kScalar;
  if (name != "avx2" && NoiseKernelAvailable(NoiseKernel::kAvx512)) return NoiseKernel::kAvx512;
  return NoiseKernelAvailable(NoiseKernel::kAvx2) ? NoiseKernel::kAvx2 : NoiseKernel::kScalar;
}

void SumNoise(NoiseKernel kernel, std::span<const NoiseOctave> octaves, const NoisePoints& points, float* values) {
  switch (kernel) {
    case NoiseKernel::kAvx512:
      return SumNoiseAvx512(octaves, points, values);
    case NoiseKernel::kAvx2:
      return SumNoiseAvx2(octaves, points, values);
    case NoiseKernel::kScalar:
      return SumNoiseScalar(octaves, points, values);
  }
}

}  // namespace rilievo::simulation
