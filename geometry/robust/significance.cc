// The binomial tail behind the number of false alarms.
#include "geometry/robust/significance.h"

#include <cmath>
#include <limits>

namespace rilievo {

double LogFalseAlarms(std::size_t inliers, std::size_t n, std::size_t sample_size, double probability, double tests,
                      double enough) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  if (inliers <= sample_size || inliers > n || !(probability < 1)) return kInfinity;
  const std::size_t draws = n - sample_size, least = inliers - sample_size;
  const double p = probability > 1e-12 ? probability : 1e-12;
  const double share = static_cast<double>(least) / static_cast<double>(draws);
  if (share > p && share < 1) {  // Chernoff: log P(X >= share draws) <= -draws KL(share || p)
    const double divergence = share * std::log(share / p) + (1 - share) * std::log((1 - share) / (1 - p));
    const double bound = std::log(tests) - static_cast<double>(draws) * divergence;
    if (bound < enough) return bound;
  }
  const double log_p = std::log(p), log_q = std::log1p(-p);
  double term = static_cast<double>(draws) * log_q;  // log of P(X = 0), then of P(X = k)
  double tail = -kInfinity;
  for (std::size_t k = 0; k <= draws; ++k) {
    if (k > 0) term += std::log(static_cast<double>(draws - k + 1) / static_cast<double>(k)) + log_p - log_q;
    if (k < least) continue;
    const double larger = tail > term ? tail : term;
    tail = larger + std::log(std::exp(tail - larger) + std::exp(term - larger));
    if (term < tail - 40 && static_cast<double>(k) > p * static_cast<double>(draws)) break;
  }
  return std::log(tests) + tail;
}

}  // namespace rilievo
