// Homographies of four and of many points, and the poses they allow.
#include "geometry/solvers/homography.h"

#include <gtest/gtest.h>

#include "tests/support/two_view_scenes.h"

namespace rilievo {
namespace {

TEST(Homography, FourPointsAndManyGiveOneMapThatHoldsForTheWholePlane) {
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    Rng rng(seed);
    const auto scene = MakeTwoViewScene(rng, {.points = 30, .planar = true});
    std::array<Eigen::Vector3d, 4> first, second;
    for (std::size_t i = 0; i < 4; ++i)
      first[i] = scene.first[i].homogeneous(), second[i] = scene.second[i].homogeneous();
    const auto four = SolveHomographyFourPoint(first, second);
    ASSERT_TRUE(four);
    const auto many = SolveHomographyLinear(scene.first, scene.second);
    ASSERT_TRUE(many);
    for (std::size_t i = 0; i < 30; ++i) {
      EXPECT_LT(((*many * scene.first[i].homogeneous()).hnormalized() - scene.second[i]).norm(), 1e-6);
      if (i < 4) {
        EXPECT_LT(((*four * first[i]).hnormalized() - scene.second[i]).norm(), 1e-8);
      }
    }
    double nearest = 9;
    for (const auto& pose : DecomposeHomography(*many)) {
      nearest = std::min(nearest, pose.rotation.angularDistance(scene.second_from_first.rotation) +
                                      pose.translation.cross(scene.second_from_first.translation.normalized()).norm());
    }
    EXPECT_LT(nearest, 1e-4);
  }
}

TEST(Homography, DegenerateSamplesGiveNone) {
  std::array<Eigen::Vector3d, 4> line,
      square{Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(1, 0, 1), Eigen::Vector3d(1, 1, 1), Eigen::Vector3d(0, 1, 1)};
  for (std::size_t i = 0; i < 4; ++i) line[i] = {static_cast<double>(i), 2, 1};
  EXPECT_FALSE(SolveHomographyFourPoint(line, square));
  std::array<Eigen::Vector3d, 4> crossed{square[0], square[1], square[3],
                                         square[2]};  // no view of a plane folds a square
  EXPECT_FALSE(SolveHomographyFourPoint(square, crossed));
  EXPECT_TRUE(SolveHomographyFourPoint(square, square));
}

}  // namespace
}  // namespace rilievo
