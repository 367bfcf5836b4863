// The noise sum on 16 floats (AVX-512).
#include "simulation/noise_kernel.h"

namespace rilievo::simulation {

void SumNoiseAvx512(std::span<const NoiseOctave> octaves, const NoisePoints& points, float* values) {
  NoiseSum<16>::Run(octaves, points, values);
}

}  // namespace rilievo::simulation
