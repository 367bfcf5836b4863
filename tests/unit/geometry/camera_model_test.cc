// Projection and its inversion are inverses; the pixel frame is COLMAP's.
#include "geometry/camera_model.h"

#include <gtest/gtest.h>

#include "base/rng.h"

namespace rilievo {
namespace {

TEST(CameraModel, NormalizeInvertsProject) {
  CameraModel m{.kind = CameraModelKind::kFullOpenCv,
                .fx = 2750,
                .fy = 2764,
                .cx = 1520.7,
                .cy = 1006.8,
                .k1 = -0.12,
                .k2 = 0.09,
                .p1 = 3e-4,
                .p2 = -5e-4,
                .k3 = -0.02,
                .k4 = 0.01,
                .k5 = -0.004,
                .k6 = 0.001};
  Rng rng(7);
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3d x(rng.Uniform(-0.6, 0.6), rng.Uniform(-0.45, 0.45), 1.0);
    const auto pixel = m.Project(3.7 * x);
    ASSERT_TRUE(pixel);
    const auto back = m.Normalize(*pixel);
    ASSERT_TRUE(back);
    EXPECT_LT((*back - x.head<2>()).norm(), 1e-11);
  }
}

TEST(CameraModel, PointsBehindTheCameraDoNotProject) {
  const CameraModel m{.fx = 1000, .fy = 1000, .cx = 500, .cy = 400};
  EXPECT_FALSE(m.Project({0.1, 0.2, 0.0}));
  EXPECT_FALSE(m.Project({0.1, 0.2, -1.0}));
}

TEST(CameraModel, BeyondTheFoldThereIsNoRay) {
  const CameraModel m{.kind = CameraModelKind::kSimpleRadial, .fx = 1000, .fy = 1000, .cx = 500, .cy = 500, .k1 = -0.3};
  EXPECT_FALSE(m.Normalize({500 + 1500, 500}));  // x(1 - 0.3 x^2) never exceeds 0.703
  EXPECT_TRUE(m.Normalize({500 + 600, 500}));
}

}  // namespace
}  // namespace rilievo
