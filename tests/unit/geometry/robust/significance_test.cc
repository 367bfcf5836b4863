// The number of false alarms against a direct sum of the binomial tail.
#include "geometry/robust/significance.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/rng.h"

namespace rilievo {
namespace {

double DirectLogTail(std::size_t least, std::size_t draws, double p) {
  long double tail = 0;
  for (std::size_t k = least; k <= draws; ++k) {
    const long double n = static_cast<long double>(draws), i = static_cast<long double>(k);
    tail += std::exp(std::lgamma(n + 1) - std::lgamma(i + 1) - std::lgamma(n - i + 1) +
                     i * std::log(static_cast<long double>(p)) + (n - i) * std::log1p(-static_cast<long double>(p)));
  }
  return static_cast<double>(std::log(tail));
}

TEST(LogFalseAlarms, IsTheBinomialTailTimesTheTests) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Rng rng(seed);
    const std::size_t n = 20 + rng.Below(800), inliers = 6 + rng.Below(static_cast<std::uint32_t>(n) - 6);
    const double p = rng.Uniform(0.01, 0.5);
    const double expected = std::log(1e4) + DirectLogTail(inliers - 5, n - 5, p);
    if (!std::isfinite(expected)) continue;
    EXPECT_NEAR(LogFalseAlarms(inliers, n, 5, p, 1e4), expected, 1e-6 * (1 + std::abs(expected)));
  }
}

TEST(LogFalseAlarms, TheShortCutNeverPromisesTooMuch) {
  int taken = 0;
  for (std::uint64_t seed = 0; seed < 500; ++seed) {
    Rng rng(seed);
    const std::size_t n = 20 + rng.Below(800), inliers = 6 + rng.Below(static_cast<std::uint32_t>(n) - 6);
    const double p = rng.Uniform(0.01, 0.5), exact = LogFalseAlarms(inliers, n, 5, p, 1e4);
    const double bounded = LogFalseAlarms(inliers, n, 5, p, 1e4, -13.8);
    EXPECT_GE(bounded, exact - 1e-9 * std::abs(exact));
    EXPECT_EQ(bounded < -13.8, exact < -13.8);
    taken += bounded != exact;
  }
  EXPECT_GT(taken, 50);
}

TEST(LogFalseAlarms, NothingToTestIsNeverSignificant) {
  EXPECT_EQ(LogFalseAlarms(5, 100, 5, 0.1, 1), INFINITY);
  EXPECT_EQ(LogFalseAlarms(101, 100, 5, 0.1, 1), INFINITY);
  EXPECT_EQ(LogFalseAlarms(50, 100, 5, 1, 1), INFINITY);
}

}  // namespace
}  // namespace rilievo
