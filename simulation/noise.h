// Band-limited multi-octave gradient noise in space: the texture and the displacement of simulated surfaces.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace rilievo::simulation {

/// One octave: lattice coordinates are q = rotation * p + offset (rotation scaled by `frequency_per_m`), noise of
/// standard deviation about 1 times `amplitude`. Rotated and shifted lattices keep octaves from lining up.
struct NoiseOctave {
  std::array<float, 9> rotation{};  ///< row-major, already multiplied by the frequency
  std::array<float, 3> offset{};
  float frequency_per_m = 1;  ///< lattice cells a metre
  float amplitude = 1;
  std::uint32_t seed = 0;
};

/// Octaves k = 0..count-1 of cell size first_cell_m / lacunarity^k and amplitude first_amplitude * persistence^k.
struct OctaveRange {
  double first_cell_m = 1, lacunarity = 2, first_amplitude = 1, persistence = 1;
  int count = 1;
};
std::vector<NoiseOctave> MakeOctaves(const OctaveRange& range, std::uint64_t seed);

/// Points as arrays of n coordinates; `footprint_m` is the size of what one sample stands for.
struct NoisePoints {
  const float* x_m;
  const float* y_m;
  const float* z_m;
  const float* footprint_m;
  std::size_t count;
};

enum class NoiseKernel { kScalar, kAvx2, kAvx512 };
/// The widest kernel of this processor, or the one that RILIEVO_KERNELS=scalar|avx2|avx512 forces (if available).
NoiseKernel SelectNoiseKernel();
bool NoiseKernelAvailable(NoiseKernel kernel);

/// values[i] = sum over octaves of amplitude * fade(footprint / cell) * noise(p_i). fade is 1 while a cell spans at
/// least 2 footprints and 0 from 1 / 0.9 footprints on (smoothstep between): little above the sampling limit is left.
/// Octaves must come by rising frequency. All kernels give the same bytes: same order of elementwise operations.
/// Cost about 5 ns (AVX2) a point and octave. Noise: Perlin, "Improving noise", 2002, with hashed gradients.
void SumNoise(NoiseKernel kernel, std::span<const NoiseOctave> octaves, const NoisePoints& points, float* values);

// The kernels themselves, one a file.
void SumNoiseScalar(std::span<const NoiseOctave> octaves, const NoisePoints& points, float* values);
void SumNoiseAvx2(std::span<const NoiseOctave> octaves, const NoisePoints& points, float* values);
void SumNoiseAvx512(std::span<const NoiseOctave> octaves, const NoisePoints& points, float* values);

}  // namespace rilievo::simulation
