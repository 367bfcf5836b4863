// Fundamental matrices of seven and of many points against exact synthetic truth.
#include "geometry/solvers/seven_point.h"

#include <gtest/gtest.h>

#include "tests/support/two_view_scenes.h"

namespace rilievo {
namespace {

double Distance(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) {
  return std::min((a / a.norm() - b / b.norm()).norm(), (a / a.norm() + b / b.norm()).norm());
}

TEST(SevenPoint, TruthIsAmongTheSolutionsAndAllObeyTheConstraints) {
  int missed = 0;
  for (std::uint64_t seed = 0; seed < 5000; ++seed) {
    Rng rng(seed);
    const auto scene = MakeTwoViewScene(rng, {.points = 7});
    std::array<Eigen::Vector3d, 7> first, second;
    for (std::size_t i = 0; i < 7; ++i)
      first[i] = scene.first[i].homogeneous(), second[i] = scene.second[i].homogeneous();
    double nearest = 9;
    for (const auto& f : SolveSevenPoint(first, second)) {
      nearest = std::min(nearest, Distance(f, scene.Essential()));
      EXPECT_LT(std::abs(f.determinant()), 1e-10);
      for (std::size_t i = 0; i < 7; ++i) EXPECT_LT(std::abs(second[i].dot(f * first[i])), 1e-10);
    }
    missed += nearest > 1e-7;
  }
  EXPECT_LE(missed, 2);  // two roots of the cubic may meet
}

TEST(EightPoint, ManyExactPointsGiveTheTruth) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Rng rng(seed);
    const auto scene = MakeTwoViewScene(rng, {.points = 40});
    for (const auto kind : {EpipolarKind::kEssential, EpipolarKind::kFundamental}) {
      const auto model = SolveEightPoint(scene.first, scene.second, {}, kind);
      ASSERT_TRUE(model);
      EXPECT_LT(Distance(*model, scene.Essential()), 1e-5);
      EXPECT_LT(std::abs(model->determinant()), 1e-12);
    }
  }
}

TEST(EightPoint, OnePlaneDoesNotDetermineF) {
  Rng rng(1);
  const auto scene = MakeTwoViewScene(rng, {.points = 40, .planar = true});
  EXPECT_FALSE(SolveEightPoint(scene.first, scene.second, {}, EpipolarKind::kFundamental));
}

}  // namespace
}  // namespace rilievo
