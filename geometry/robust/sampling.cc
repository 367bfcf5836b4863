// Random orders and trial counts of robust estimation.
#include "geometry/robust/sampling.h"

#include <cmath>
#include <utility>

namespace rilievo {

std::vector<std::uint32_t> ShuffledOrder(std::size_t n, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<std::uint32_t> order(n);
  for (std::size_t i = 0; i < n; ++i) order[i] = static_cast<std::uint32_t>(i);
  for (std::size_t i = n; i > 1; --i) std::swap(order[i - 1], order[rng.Below(static_cast<std::uint32_t>(i))]);
  return order;
}

int RequiredTrials(std::size_t inliers, std::size_t n, int sample_size, double confidence, int max_trials) {
  double good_sample = 1;
  for (int i = 0; i < sample_size; ++i) {
    if (inliers <= static_cast<std::size_t>(i)) return max_trials;
    good_sample *= static_cast<double>(inliers - i) / static_cast<double>(n - i);
  }
  if (good_sample >= 1 || confidence <= 0) return 1;
  const double trials = std::log1p(-confidence) / std::log1p(-good_sample);
  if (!(trials < max_trials)) return max_trials;
  return trials < 1 ? 1 : static_cast<int>(std::ceil(trials));
}

}  // namespace rilievo
