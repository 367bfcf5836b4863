// Coverage of an image against a count of occupied cells by their borders.
#include "block/coverage.h"

#include <gtest/gtest.h>

#include "base/rng.h"

namespace rilievo {
namespace {

TEST(Coverage, IsTheShareOfOccupiedCells) {
  Rng rng(5);
  for (int round = 0; round < 50; ++round) {
    const int width = 1 + static_cast<int>(rng.Below(900)), height = 1 + static_cast<int>(rng.Below(900));
    std::vector<Keypoint> keypoints(rng.Below(120));
    for (Keypoint& k : keypoints) {
      k.x_px = static_cast<float>(rng.Uniform(0, width));
      k.y_px = static_cast<float>(rng.Uniform(0, height));
    }
    int occupied = 0;
    for (int row = 0; row < 8; ++row)
      for (int column = 0; column < 8; ++column) {
        bool holds_one = false;
        for (const Keypoint& k : keypoints)
          holds_one |= 8.0 * k.x_px >= column * width && 8.0 * k.x_px < (column + 1) * width &&
                       8.0 * k.y_px >= row * height && 8.0 * k.y_px < (row + 1) * height;
        occupied += holds_one ? 1 : 0;
      }
    EXPECT_DOUBLE_EQ(Coverage(keypoints, width, height), occupied / 64.0);
  }
}

TEST(Coverage, BordersBelongToTheImage) {
  CoverageGrid grid(100, 50);
  EXPECT_EQ(grid.Share(), 0);
  grid.Add({100, 50});
  grid.Add({99.9, 49.9});
  EXPECT_EQ(grid.Share(), 1 / 64.0);
}

}  // namespace
}  // namespace rilievo
