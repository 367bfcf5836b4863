// The five-point solver against exact synthetic truth.
#include "geometry/solvers/five_point.h"

#include <gtest/gtest.h>

#include "base/rng.h"
#include "tests/support/two_view_scenes.h"

namespace rilievo {
namespace {

double Distance(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) {
  return std::min((a / a.norm() - b / b.norm()).norm(), (a / a.norm() + b / b.norm()).norm());
}

struct Statistics {
  double worst_truth = 0, worst_constraint = 0;
  int missed = 0, solutions = 0;
};

Statistics SolveMany(int scenes, bool planar, std::uint64_t seed) {
  Statistics s;
  for (int i = 0; i < scenes; ++i) {
    Rng rng(SeedFor(seed, i));
    const auto scene = MakeTwoViewScene(rng, {.points = 5, .planar = planar});
    std::array<Eigen::Vector3d, 5> first, second;
    for (std::size_t k = 0; k < 5; ++k) {
      first[k] = scene.first[k].homogeneous();
      second[k] = scene.second[k].homogeneous();
    }
    double nearest = 9;
    for (const auto& e : SolveFivePoint(first, second)) {
      nearest = std::min(nearest, Distance(e, scene.Essential()));
      const Eigen::Matrix3d eet = e * e.transpose();
      s.worst_constraint =
          std::max({s.worst_constraint, (2 * eet * e - eet.trace() * e).norm(), std::abs(e.determinant())});
      for (std::size_t k = 0; k < 5; ++k) {
        s.worst_constraint = std::max(s.worst_constraint, std::abs(second[k].dot(e * first[k])));
      }
      ++s.solutions;
    }
    s.missed += nearest > 1e-8;
    if (nearest < 1) s.worst_truth = std::max(s.worst_truth, nearest);
  }
  return s;
}

TEST(FivePoint, TruthIsAmongTheSolutionsAndAllObeyTheConstraints) {
  const auto s = SolveMany(20000, false, 1);
  EXPECT_EQ(s.missed, 0) << s.worst_truth;
  EXPECT_LT(s.worst_constraint, 1e-9);
}

TEST(FivePoint, PlanarScenesAreNoSpecialCase) {
  const auto s = SolveMany(20000, true, 2);
  EXPECT_LE(s.missed, 10);  // five points of a plane can lie so that two solutions meet: ill-conditioned by nature
  EXPECT_LT(s.worst_constraint, 1e-9);
}

TEST(FivePoint, DegenerateSamplesGiveFiniteMatricesOrNone) {
  std::array<Eigen::Vector3d, 5> first, second;
  for (std::size_t i = 0; i < 5; ++i) first[i] = second[i] = Eigen::Vector3d(0.1, 0.2, 1);
  for (const auto& e : SolveFivePoint(first, second)) EXPECT_TRUE(e.allFinite());
  for (std::size_t i = 0; i < 5; ++i) first[i] = second[i] = Eigen::Vector3d(0.1 * static_cast<double>(i), 0.3, 1);
  for (const auto& e : SolveFivePoint(first, second)) EXPECT_TRUE(e.allFinite());
}

}  // namespace
}  // namespace rilievo
