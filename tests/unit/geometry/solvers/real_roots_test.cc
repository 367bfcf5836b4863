// Real roots against polynomials whose roots are known and against a companion matrix.
#include "geometry/solvers/real_roots.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <vector>

#include "base/rng.h"

namespace rilievo {
namespace {

template <int N>
std::array<double, N + 1> FromRoots(const std::vector<double>& real,
                                    const std::vector<std::array<double, 2>>& complex) {
  std::array<double, N + 1> p{1};
  int degree = 0;
  const auto multiply = [&](std::array<double, 3> factor, int by) {
    std::array<double, N + 1> product{};
    for (int i = 0; i <= degree; ++i) {
      for (int j = 0; j <= by; ++j)
        product[static_cast<std::size_t>(i + j)] +=
            p[static_cast<std::size_t>(i)] * factor[static_cast<std::size_t>(j)];
    }
    p = product;
    degree += by;
  };
  for (const double r : real) multiply({-r, 1, 0}, 1);
  for (const auto& [a, b] : complex) multiply({a * a + b * b, -2 * a, 1}, 2);
  EXPECT_EQ(degree, N);
  return p;
}

TEST(RealRoots, FindsAllKnownRootsAndNoOthers) {
  for (std::uint64_t seed = 0; seed < 5000; ++seed) {
    Rng rng(seed);
    std::vector<double> roots;
    std::vector<std::array<double, 2>> complex;
    for (std::size_t i = 0, pairs = rng.Below(6); i < 5; ++i) {
      if (i < pairs)
        complex.push_back({rng.Normal(), 0.05 + std::abs(rng.Normal())});
      else
        for (int k = 0; k < 2; ++k) roots.push_back(rng.Normal() / (0.05 + rng.Uniform()));
    }
    std::sort(roots.begin(), roots.end());
    bool distinct = true;
    for (std::size_t i = 1; i < roots.size(); ++i)
      distinct = distinct && roots[i] - roots[i - 1] > 0.01 * (1 + std::abs(roots[i]));
    if (!distinct) continue;
    const auto found = RealRoots<10>(FromRoots<10>(roots, complex));
    ASSERT_EQ(found.size(), static_cast<int>(roots.size())) << seed;
    for (int i = 0; i < found.size(); ++i)
      EXPECT_NEAR(found[i], roots[static_cast<std::size_t>(i)], 1e-5 * (1 + std::abs(found[i])));
  }
}

TEST(RealRoots, OfACubicAreThoseOfItsCompanionMatrix) {
  for (std::uint64_t seed = 0; seed < 5000; ++seed) {
    Rng rng(seed);
    std::array<double, 4> p;
    for (double& c : p) c = rng.Normal();
    Eigen::Matrix3d companion = Eigen::Matrix3d::Zero();
    companion << 0, 0, -p[0] / p[3], 1, 0, -p[1] / p[3], 0, 1, -p[2] / p[3];
    std::vector<double> expected;
    for (const auto& value : companion.eigenvalues()) {
      if (std::abs(value.imag()) < 1e-7 * (1 + std::abs(value))) expected.push_back(value.real());
    }
    std::sort(expected.begin(), expected.end());
    const auto found = RealRoots<3>(p);
    ASSERT_EQ(found.size(), static_cast<int>(expected.size())) << seed;
    for (int i = 0; i < found.size(); ++i)
      EXPECT_NEAR(found[i], expected[static_cast<std::size_t>(i)], 1e-6 * (1 + std::abs(found[i])));
  }
}

TEST(RealRoots, AMultipleRootIsOneRootAndAnEndOfABracketMayBeOne) {
  const auto found = RealRoots<3>(FromRoots<3>({2, 2, -1}, {}));
  ASSERT_EQ(found.size(), 2);
  EXPECT_NEAR(found[0], -1, 1e-9);
  EXPECT_NEAR(found[1], 2, 1e-6);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(RealRoots<3>(FromRoots<3>({-1, 0, 1}, {}))[i], i - 1, 1e-12);
  }
}

TEST(RealRoots, OfNoPolynomialOfThatDegreeAreNone) {
  EXPECT_EQ(RealRoots<3>({1, 2, 3, 0}).size(), 0);
  EXPECT_EQ(RealRoots<3>({1, 2, std::nan(""), 1}).size(), 0);
}

}  // namespace
}  // namespace rilievo
