// The noise sum on 8 floats (AVX2).
#include "simulation/noise_kernel.h"

namespace rilievo::simulation {

void SumNoiseAvx2(std::span<const NoiseOctave> octaves, const NoisePoints& points, float* values) {
  NoiseSum<8>::Run(octaves, points, values);
}

}  // namespace rilievo::simulation
