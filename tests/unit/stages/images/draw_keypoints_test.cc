// Drawings: circles and ticks where the keypoints are, nothing elsewhere, large images reduced.
#include "stages/images/draw_keypoints.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <opencv2/imgcodecs.hpp>

namespace rilievo::images {
namespace {

GreyImage Black(int width_px, int height_px) {
  GreyImage image;
  image.width_px = width_px, image.height_px = height_px;
  image.u8.assign(static_cast<std::size_t>(width_px * height_px), 0);
  return image;
}

cv::Mat Drawn(const GreyImage& image, const std::vector<Keypoint>& keypoints, std::uint64_t max_pixels = 1 << 20) {
  return cv::imdecode(DrawKeypoints(image, keypoints, max_pixels), cv::IMREAD_COLOR);
}

int Brightness(const cv::Mat& drawing, double x_px, double y_px) {
  const auto* p = drawing.ptr<std::uint8_t>(static_cast<int>(y_px)) + 3 * static_cast<int>(x_px);
  return std::max({p[0], p[1], p[2]});
}

TEST(DrawKeypoints, ACircleOfThreeTimesTheScaleWithATickInItsDirection) {
  const Keypoint keypoint{.x_px = 60.5F, .y_px = 40.5F, .scale_px = 7, .angle_rad = std::numbers::pi_v<float> / 2};
  const cv::Mat drawing = Drawn(Black(120, 90), {keypoint});
  ASSERT_EQ(drawing.cols, 120);
  ASSERT_EQ(drawing.rows, 90);
  for (int y = 0; y < drawing.rows; ++y)
    for (int x = 0; x < drawing.cols; ++x) {
      const double dx = x + 0.5 - keypoint.x_px, dy = y + 0.5 - keypoint.y_px, radius = std::hypot(dx, dy);
      const bool on_tick = std::abs(dx) < 2.5 && dy > -2.5 && dy < 23;  // y is down: a quarter turn points down
      if (std::abs(radius - 21) > 2.5 && !on_tick) {
        EXPECT_EQ(Brightness(drawing, x, y), 0) << x << " " << y;
      }
    }
  for (int k = 0; k < 16; ++k) {
    const double angle = k * std::numbers::pi / 8;
    EXPECT_GT(Brightness(drawing, 60.5 + 21 * std::cos(angle), 40.5 + 21 * std::sin(angle)), 60) << k;
  }
  for (int r = 0; r < 21; ++r) EXPECT_GT(Brightness(drawing, 60.5, 40.5 + r), 60) << r;
}

TEST(DrawKeypoints, OctavesHaveTheirColors) {
  const auto color_at = [](float scale_px) {
    const cv::Mat drawing =
        Drawn(Black(400, 400), {{.x_px = 200.5F, .y_px = 200.5F, .scale_px = scale_px, .angle_rad = 0}});
    return drawing.at<cv::Vec3b>(200, 201);
  };
  EXPECT_EQ(color_at(1.7F), color_at(3.1F));
  EXPECT_NE(color_at(3.1F), color_at(3.3F));
  EXPECT_NE(color_at(6.0F), color_at(12.0F));
  EXPECT_NE(color_at(0.01F), cv::Vec3b()) << "tiny scales are drawn too";
}

TEST(DrawKeypoints, LargeImagesAreReducedByTheMean) {
  GreyImage image = Black(301, 200);
  for (std::size_t i = 0; i < image.u8.size(); ++i) image.u8[i] = static_cast<std::uint8_t>(i % 301 % 3 == 0 ? 90 : 30);
  const cv::Mat drawing = Drawn(image, {{.x_px = 150, .y_px = 99, .scale_px = 10, .angle_rad = 0}}, 301 * 200 / 5);
  ASSERT_EQ(drawing.cols, 101);
  ASSERT_EQ(drawing.rows, 67);
  EXPECT_EQ(drawing.at<cv::Vec3b>(5, 5), cv::Vec3b(50, 50, 50));
  EXPECT_EQ(drawing.at<cv::Vec3b>(66, 100), cv::Vec3b(90, 90, 90)) << "a part of a cell at the border";
  EXPECT_NE(drawing.at<cv::Vec3b>(33, 50 + 10), cv::Vec3b(50, 50, 50)) << "radius 30 px is 10 reduced ones";
}

TEST(DrawKeypoints, ColorsOfTheImageStay) {
  GreyImage image = Black(4, 3);
  image.rgb.assign(36, 0);
  image.rgb[3 * 5] = 200, image.rgb[3 * 5 + 1] = 100, image.rgb[3 * 5 + 2] = 50;
  EXPECT_EQ(Drawn(image, {}).at<cv::Vec3b>(1, 1), cv::Vec3b(50, 100, 200));
}

}  // namespace
}  // namespace rilievo::images
