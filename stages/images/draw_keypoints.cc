// Circles and ticks through OpenCV, over an image reduced by box means.
#include "stages/images/draw_keypoints.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "base/error.h"

namespace rilievo::images {
namespace {

/// Octaves from fine to coarse, blue to red (blue, green, red as OpenCV orders them).
constexpr std::array<std::array<int, 3>, 8> kOctaveColors{{{255, 128, 0},
                                                           {255, 255, 0},
                                                           {128, 255, 0},
                                                           {0, 255, 0},
                                                           {0, 255, 255},
                                                           {0, 160, 255},
                                                           {0, 64, 255},
                                                           {255, 0, 255}}};

cv::Scalar ColorOf(const Keypoint& keypoint) {
  constexpr double kFirstScale_px = 0.8;  // SIFT on the doubled image
  const double octave = std::floor(std::log2(std::max<double>(keypoint.scale_px, kFirstScale_px) / kFirstScale_px));
  const auto& c = kOctaveColors[static_cast<std::size_t>(std::clamp(octave, 0.0, kOctaveColors.size() - 1.0))];
  return {static_cast<double>(c[0]), static_cast<double>(c[1]), static_cast<double>(c[2])};
}

/// Least whole factor that leaves at most `max_pixels`; sides are rounded up.
int ReductionOf(int width_px, int height_px, std::uint64_t max_pixels) {
  const auto side = [](int size_px, int factor) { return (static_cast<std::uint64_t>(size_px) + factor - 1) / factor; };
  int factor = 1;
  while (side(width_px, factor) * side(height_px, factor) > max_pixels && side(width_px, factor) > 1) ++factor;
  return factor;
}

/// Sum of channel `c` (blue first) over columns [x0, x1) of row y, and grey where there is no colour.
unsigned RowSum(const GreyImage& image, int y, int x0, int x1, int c) {
  const std::size_t row = static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width_px);
  unsigned sum = 0;
  for (std::size_t i = row + static_cast<std::size_t>(x0); i < row + static_cast<std::size_t>(x1); ++i)
    sum += !image.rgb.empty() ? image.rgb[3 * i + 2 - static_cast<std::size_t>(c)]
           : image.Is16Bit()  ? static_cast<unsigned>(image.u16[i] >> 8)
                              : image.u8[i];
  return sum;
}

cv::Mat Canvas(const GreyImage& image, int factor) {
  cv::Mat canvas((image.height_px + factor - 1) / factor, (image.width_px + factor - 1) / factor, CV_8UC3);
  for (int y = 0; y < canvas.rows; ++y) {
    const int y0 = y * factor, y1 = std::min(y0 + factor, image.height_px);
    for (int x = 0; x < canvas.cols; ++x) {
      const int x0 = x * factor, x1 = std::min(x0 + factor, image.width_px);
      const unsigned count = static_cast<unsigned>((y1 - y0) * (x1 - x0));
      for (int c = 0; c < 3; ++c) {
        unsigned sum = 0;
        for (int row = y0; row < y1; ++row) sum += RowSum(image, row, x0, x1, c);
        canvas.ptr<std::uint8_t>(y)[3 * x + c] = static_cast<std::uint8_t>((sum + count / 2) / count);
      }
    }
  }
  return canvas;
}

/// OpenCV draws in 1/16 px and counts from the first pixel's centre.
void Draw(cv::Mat& canvas, const Keypoint& keypoint, double factor) {
  constexpr int kShift = 4;
  const auto fixed = [](double value_px) { return static_cast<int>(std::lround(value_px * (1 << kShift))); };
  const double radius_px = std::max(1.5, kDrawnRadius * keypoint.scale_px / factor);
  const double x_px = keypoint.x_px / factor - 0.5, y_px = keypoint.y_px / factor - 0.5;
  const cv::Scalar color = ColorOf(keypoint);
  cv::circle(canvas, {fixed(x_px), fixed(y_px)}, fixed(radius_px), color, 1, cv::LINE_AA, kShift);
  cv::line(
      canvas, {fixed(x_px), fixed(y_px)},
      {fixed(x_px + radius_px * std::cos(keypoint.angle_rad)), fixed(y_px + radius_px * std::sin(keypoint.angle_rad))},
      color, 1, cv::LINE_AA, kShift);
}

}  // namespace

std::vector<unsigned char> DrawKeypoints(const GreyImage& image, std::span<const Keypoint> keypoints,
                                         std::uint64_t max_pixels) {
  const int factor = ReductionOf(image.width_px, image.height_px, max_pixels);
  try {
    std::vector<unsigned char> png;
    cv::Mat canvas = Canvas(image, factor);
    for (const Keypoint& keypoint : keypoints) Draw(canvas, keypoint, factor);
    if (cv::imencode(".png", canvas, png)) return png;
  } catch (const cv::Exception&) {
    // One cause is known, and said below.
  }
  throw Error(ErrorCode::kUnsupported, "", "the drawing cannot be written as PNG", "draw a smaller image");
}

std::uint64_t DrawKeypointsBytes(int width_px, int height_px) {
  const auto pixels = static_cast<std::uint64_t>(width_px) * static_cast<std::uint64_t>(height_px);
  // The canvas, the file as it grows (up to twice its size, and once more while it moves); noise does not compress.
  return std::min(pixels, kMaxDrawnPixels) * 3 * 4 + (std::uint64_t{4} << 20);
}

}  // namespace rilievo::images
