// Integrates box and Gaussian.
#include "simulation/psf.h"

#include <algorithm>
#include <cmath>

namespace rilievo::simulation {

Psf::Psf(double sigma_px, int samples) {
  radius_px = std::clamp(static_cast<int>(std::ceil(3.5 * sigma_px)), 0, 16);
  const int count = (2 * radius_px + 1) * samples;
  std::vector<double> weights;
  double sum = 0;
  for (int k = 0; k < count; ++k) {
    const double offset_px = (k + 0.5) / samples - (radius_px + 0.5);
    // integral of the Gaussian over [offset - 0.5, offset + 0.5]
    const double scale = 1 / (std::sqrt(2.0) * std::max(sigma_px, 1e-6));
    weights.push_back(0.5 * (std::erf((offset_px + 0.5) * scale) - std::erf((offset_px - 0.5) * scale)));
    sum += weights.back();
  }
  for (const double weight : weights) taps.push_back(static_cast<float>(weight / sum));
}

}  // namespace rilievo::simulation
