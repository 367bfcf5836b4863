// SIFT through OpenCV: pixel frame, total order, cut and RootSIFT on this side of the wall.
#include "stages/features/sift.h"

#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <numbers>
#include <numeric>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <tuple>
#include <vector>

#include "base/check.h"
#include "base/error.h"

namespace rilievo::features {
namespace {

/// OpenCV counts from the first pixel's centre (+0.5 to our frame). It doubles the image by a resize that puts pixel i
/// of the large image at i/2 - 0.25 of the small one but maps positions back by i/2, so all of them, in every octave,
/// come out 0.25 px too large (OpenCV before 4.8; its octaves are decimated without a further shift).
constexpr float kFrameShift_px = 0.5F - 0.25F;

/// OpenCV looks for extrema at least 5 px from the border of the doubled image: smaller images have none.
constexpr int kSmallestSide_px = 6;

/// 16-bit pixels to 8 bits: a shift by the bits that the brightest pixel uses beyond eight, so 10-, 12- and 14-bit data
/// in 16-bit files keep their 8 leading bits, nothing is clipped and full-range files are simply divided by 256.
std::vector<std::uint8_t> ToEightBits(const std::vector<std::uint16_t>& u16) {
  const std::uint16_t brightest = u16.empty() ? std::uint16_t{0} : *std::max_element(u16.begin(), u16.end());
  int shift = 0;
  while ((brightest >> shift) > 255) ++shift;
  std::vector<std::uint8_t> u8(u16.size());
  std::transform(u16.begin(), u16.end(), u8.begin(),
                 [shift](std::uint16_t v) { return static_cast<std::uint8_t>(v >> shift); });
  return u8;
}

struct Detection {
  std::vector<cv::KeyPoint> keypoints;
  cv::Mat descriptors;  ///< one row of 128 bytes a keypoint
};

/// 3 layers an octave and sigma 1.6 (Lowe 2004). OpenCV keeps all keypoints that tie with the last one: the caller
/// cuts.
Detection Detect(const cv::Mat& grey, int max_features, const Options& options) {
  Detection result;
  try {
    cv::SIFT::create(max_features, 3, options.contrast_threshold, options.edge_threshold, 1.6, CV_8U)
        ->detectAndCompute(grey, cv::noArray(), result.keypoints, result.descriptors);
  } catch (const cv::Exception& e) {
    if (e.code != cv::Error::StsNoMem) throw Error(ErrorCode::kInternal, "", "OpenCV's SIFT failed: " + e.err);
    throw std::bad_alloc();
  }
#if defined(__GLIBC__)
  // The layers of the second octave and beyond come from the heap, where one small block above them keeps all of their
  // pages: without this some 200 MB stay resident after each image of 6 Mpx.
  malloc_trim(0);
#endif
  return result;
}

Keypoint FromOpenCv(const cv::KeyPoint& k) {
  constexpr double kRadPerDeg = std::numbers::pi / 180.0;
  return {.x_px = k.pt.x + kFrameShift_px,
          .y_px = k.pt.y + kFrameShift_px,
          .scale_px = 0.5F * k.size,  // OpenCV's size is a diameter, 2 sigma
          .angle_rad = static_cast<float>(k.angle * kRadPerDeg),
          .response = k.response};
}

/// Index of the pixel under a keypoint.
std::size_t PixelAt(const GreyImage& image, const Keypoint& keypoint) {
  const int column = std::clamp(static_cast<int>(keypoint.x_px), 0, image.width_px - 1);
  const int row = std::clamp(static_cast<int>(keypoint.y_px), 0, image.height_px - 1);
  return static_cast<std::size_t>(row) * static_cast<std::size_t>(image.width_px) + static_cast<std::size_t>(column);
}

auto PositionOrder(const Keypoint& k) { return std::tie(k.y_px, k.x_px, k.scale_px, k.angle_rad); }

/// Indices of the keypoints to keep, in the order of the result: usable, without repetitions, the strongest
/// `max_features`.
std::vector<std::uint32_t> Select(const std::vector<Keypoint>& keypoints, const Input& input,
                                  std::size_t max_features) {
  std::vector<std::uint32_t> order;
  for (std::uint32_t i = 0; i < keypoints.size(); ++i)
    if (input.mask.empty() || input.mask[PixelAt(input.image, keypoints[i])] >= 128) order.push_back(i);
  const auto by_position = [&](std::uint32_t a, std::uint32_t b) {
    return PositionOrder(keypoints[a]) != PositionOrder(keypoints[b])
               ? PositionOrder(keypoints[a]) < PositionOrder(keypoints[b])
               : keypoints[a].response > keypoints[b].response;
  };
  std::sort(order.begin(), order.end(), by_position);
  order.erase(std::unique(order.begin(), order.end(),
                          [&](std::uint32_t a, std::uint32_t b) {
                            return PositionOrder(keypoints[a]) == PositionOrder(keypoints[b]);
                          }),
              order.end());
  if (order.size() <= max_features) return order;
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return keypoints[a].response != keypoints[b].response ? keypoints[a].response > keypoints[b].response
                                                          : by_position(a, b);
  });
  order.resize(max_features);
  std::sort(order.begin(), order.end(), by_position);
  return order;
}

/// RootSIFT (Arandjelovic & Zisserman 2012): the square root of the L1-normalised histogram, norm 512.
SiftDescriptor RootSift(const std::uint8_t* raw) {
  const int sum = std::accumulate(raw, raw + 128, 0);
  SiftDescriptor result{};
  if (sum == 0) return result;
  for (std::size_t i = 0; i < result.size(); ++i) {
    const double root = 512.0 * std::sqrt(static_cast<double>(raw[i]) / sum);
    result[i] = static_cast<std::uint8_t>(std::min(255.0, std::round(root)));
  }
  return result;
}

Rgb ColorAt(const GreyImage& image, const std::vector<std::uint8_t>& grey, const Keypoint& keypoint) {
  const std::size_t pixel = PixelAt(image, keypoint);
  if (image.rgb.empty()) return {grey[pixel], grey[pixel], grey[pixel]};
  return {image.rgb[3 * pixel], image.rgb[3 * pixel + 1], image.rgb[3 * pixel + 2]};
}

}  // namespace

std::span<const OptionDeclaration<Options>> OptionDeclarations() {
  // Positional, all fields given: g++ 12 fails on designated initialisers of this template.
  static const std::vector<OptionDeclaration<Options>> declarations = {
      {"max-features",
       &Options::max_features,
       1,
       1 << 20,
       "features an image",
       "keep the strongest features of an image up to this number",
       {}},
      {"contrast-threshold",
       &Options::contrast_threshold,
       0.001,
       0.2,
       "",
       "least contrast of a feature, as a share of the full grey range; lower it for weak texture",
       {}},
      {"edge-threshold",
       &Options::edge_threshold,
       1,
       100,
       "",
       "largest ratio of the two curvatures of a feature; higher keeps more points along edges",
       {}},
      {"root-sift", &Options::root_sift, 0, 1, "", "compare descriptors by the Hellinger distance (RootSIFT)", {}},
  };
  return declarations;
}

TaskCost Estimate(int width_px, int height_px, const Options& options) {
  const auto pixels =
      static_cast<std::uint64_t>(std::max(width_px, 0)) * static_cast<std::uint64_t>(std::max(height_px, 0));
  const auto features = static_cast<std::uint64_t>(std::max(options.max_features, 0));
  // Doubled image, 4/3 for the octaves, 6 Gaussian and 5 difference layers of floats: 4 * 4/3 * 11 * 4 bytes = 234.7 a
  // pixel; 16-bit pixels, their 8-bit copy and colours: 6; keypoints before the cut: a few hundredths of one a pixel,
  // 28 bytes each.
  return {.peak_bytes = (8 << 20) + 246 * pixels + 512 * features, .work = 0.25e-6 * static_cast<double>(pixels)};
}

ImageFeatures Run(const Input& input, const Options& options, RunContext& context) {
  const auto& [image, mask] = input;
  const std::size_t pixels = static_cast<std::size_t>(image.width_px) * static_cast<std::size_t>(image.height_px);
  RILIEVO_CHECK(image.width_px >= 0 && image.height_px >= 0);
  RILIEVO_CHECK((image.Is16Bit() ? image.u16.size() : image.u8.size()) == pixels);
  RILIEVO_CHECK(image.rgb.empty() || image.rgb.size() == 3 * pixels);
  RILIEVO_CHECK(mask.empty() || mask.size() == pixels);
  context.ThrowIfStopped();
  if (std::min(image.width_px, image.height_px) < kSmallestSide_px) return {};

  const std::vector<std::uint8_t> converted = image.Is16Bit() ? ToEightBits(image.u16) : std::vector<std::uint8_t>{};
  const std::vector<std::uint8_t>& grey = image.Is16Bit() ? converted : image.u8;
  // OpenCV reads its input only; its Mat has no const form.
  const cv::Mat mat(image.height_px, image.width_px, CV_8UC1, const_cast<std::uint8_t*>(grey.data()));
  const auto [cv_keypoints, cv_descriptors] = Detect(mat, mask.empty() ? options.max_features : 0, options);  // 0 = all
  context.ThrowIfStopped();

  std::vector<Keypoint> keypoints(cv_keypoints.size());
  std::transform(cv_keypoints.begin(), cv_keypoints.end(), keypoints.begin(), FromOpenCv);
  ImageFeatures result;
  for (const std::uint32_t i : Select(keypoints, input, static_cast<std::size_t>(options.max_features))) {
    const auto* raw = cv_descriptors.ptr<std::uint8_t>(static_cast<int>(i));
    result.keypoints.push_back(keypoints[i]);
    if (options.root_sift) {
      result.descriptors.push_back(RootSift(raw));
    } else {
      std::copy(raw, raw + 128, result.descriptors.emplace_back().begin());
    }
    result.colors.push_back(ColorAt(image, grey, keypoints[i]));
  }
  return result;
}

}  // namespace rilievo::features
