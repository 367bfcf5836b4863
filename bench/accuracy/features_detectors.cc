// The detectors that features_eval compares: the stage's and OpenCV's, called here and nowhere else.
#include "bench/accuracy/features_detectors.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <numeric>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "base/check.h"
#include "base/error.h"
#include "stages/features/kernel_choice.h"
#include "stages/features/sift.h"
#include "stages/images/decode.h"

namespace rilievo::bench {
namespace {

/// OpenCV counts from the first pixel's centre (+0.5 to our frame). Up to 4.7 its doubled image puts pixel i at
/// i/2 - 0.25 of the small one but maps back by i/2, so that all positions come out 0.25 px too large.
constexpr float kPeerShift_px = CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR < 8 ? 0.5F - 0.25F : 0.5F;

cv::Mat AsMat(const GreyImage& image) {
  RILIEVO_CHECK(!image.Is16Bit());
  // OpenCV reads its input only; its Mat has no const form.
  return {image.height_px, image.width_px, CV_8UC1, const_cast<std::uint8_t*>(image.u8.data())};
}

cv::Ptr<cv::SIFT> MakePeer(const PeerOptions& options) {
  return cv::SIFT::create(0, 3, options.contrast_threshold, options.edge_threshold, 1.6, CV_8U);
}

}  // namespace

features::Options AllFeatures() {
  features::Options options;
  options.max_features = 1 << 20;
  return options;
}

ImageFeatures DetectOurs(const GreyImage& image, const features::Options& options, RunContext& context) {
  return features::Run({image}, options, context);
}

std::optional<ImageFeatures> DetectOursTiled(const GreyImage& image, const features::Options& options, int tile_px,
                                             RunContext& context) {
  const int width_px = tile_px > 0 ? tile_px : 2 * image.width_px;
  return features::Run({image, {}, {.strip_width_px = width_px, .chunks = 8}}, options, context);
}

std::optional<std::size_t> DetectOursExtremaOnly(const GreyImage& image, const features::Options& options,
                                                 RunContext& context) {
  const features::SiftOptions sift{
      options.first_octave, {options.contrast_threshold, options.edge_threshold}, options.octaves, {}};
  const features::SelectionRule rule{static_cast<std::size_t>(options.max_features), false, image.width_px,
                                     image.height_px};
  const auto& kernels = features::ChooseSiftKernels(features::ForcedKernels());
  return features::DetectSift({image}, sift, rule, kernels, context).size();
}

std::optional<SurfChoice> ChooseSurf128(const GreyImage& image, std::size_t least_features, RunContext& context) {
  SurfChoice choice{AllFeatures()};
  choice.options.detector = "surf-128";
  while (DetectOurs(image, choice.options, context).keypoints.size() < least_features) {
    choice.options.hessian_threshold *= 0.8;
    if (choice.options.hessian_threshold < 0.05) return std::nullopt;
  }
  return choice;
}

std::size_t PeerDetect(const GreyImage& image, const PeerOptions& options) {
  std::vector<cv::KeyPoint> keypoints;
  MakePeer(options)->detect(AsMat(image), keypoints);
  return keypoints.size();
}

std::size_t PeerDetectAndCompute(const GreyImage& image, const PeerOptions& options) {
  std::vector<cv::KeyPoint> keypoints;
  cv::Mat descriptors;
  MakePeer(options)->detectAndCompute(AsMat(image), cv::noArray(), keypoints, descriptors);
  return keypoints.size();
}

ImageFeatures DetectPeer(const GreyImage& image, const PeerOptions& options) {
  std::vector<cv::KeyPoint> keypoints;
  cv::Mat descriptors;
  MakePeer(options)->detectAndCompute(AsMat(image), cv::noArray(), keypoints, descriptors);
  ImageFeatures result;
  for (std::size_t i = 0; i < keypoints.size(); ++i) {
    const cv::KeyPoint& k = keypoints[i];
    result.keypoints.push_back({.x_px = k.pt.x + kPeerShift_px,
                                .y_px = k.pt.y + kPeerShift_px,
                                .scale_px = 0.5F * k.size,  // a diameter, 2 sigma
                                .angle_rad = static_cast<float>(k.angle * std::numbers::pi / 180),
                                .response = k.response});
    const auto* row = descriptors.ptr<std::uint8_t>(static_cast<int>(i));
    std::copy(row, row + 128, result.descriptors.emplace_back().begin());
    result.colors.push_back({});
  }
  return result;
}

PeerOptions PeerWithAtMost(const GreyImage& image, const PeerOptions& wanted, std::size_t most_features) {
  std::vector<cv::KeyPoint> keypoints;
  MakePeer(wanted)->detect(AsMat(image), keypoints);
  if (keypoints.size() <= most_features) return wanted;
  std::vector<float> responses;
  for (const cv::KeyPoint& k : keypoints) responses.push_back(k.response);
  std::sort(responses.begin(), responses.end(), std::greater<>());
  PeerOptions options = wanted;
  // OpenCV keeps 3 * response >= threshold (3 layers); its first, coarse test may drop a few more or less.
  options.contrast_threshold = std::max(wanted.contrast_threshold, 3.0 * static_cast<double>(responses[most_features]));
  for (int i = 0; i < 20; ++i) {
    if (PeerDetect(image, options) <= most_features) return options;
    options.contrast_threshold *= 1.002;
  }
  throw Error(ErrorCode::kInternal, "", "no threshold gives OpenCV's SIFT so few features");
}

std::vector<Descriptor> RootSift(const std::vector<Descriptor>& plain) {
  std::vector<Descriptor> result(plain.size());
  for (std::size_t i = 0; i < plain.size(); ++i) {
    const int sum = std::accumulate(plain[i].begin(), plain[i].end(), 0);
    if (sum == 0) continue;
    std::transform(plain[i].begin(), plain[i].end(), result[i].begin(), [sum](std::uint8_t v) {
      return static_cast<std::uint8_t>(
          std::min(255.0, std::round(512.0 * std::sqrt(static_cast<double>(v) / static_cast<double>(sum)))));
    });
  }
  return result;
}

ImageFeatures Strongest(const ImageFeatures& features, std::size_t count) {
  std::vector<std::size_t> order(features.keypoints.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return features.keypoints[a].response > features.keypoints[b].response;
  });
  order.resize(std::min(count, order.size()));
  std::sort(order.begin(), order.end());
  ImageFeatures result;
  for (const std::size_t i : order) {
    result.keypoints.push_back(features.keypoints[i]);
    result.descriptors.push_back(features.descriptors[i]);
  }
  return result;
}

GreyImage LoadGrey(const std::string& path) {
  const std::filesystem::path file(path);
  if (file.extension() != ".pgm" && file.extension() != ".ppm") {
    GreyImage image = images::FolderPixelSource(file.parent_path()).Load(file.filename().string(), false);
    if (image.Is16Bit()) throw Error(ErrorCode::kUnsupported, path, "OpenCV's SIFT takes 8 bits a pixel only");
    return image;
  }
  const cv::Mat mat = cv::imread(path, cv::IMREAD_GRAYSCALE);
  if (mat.empty()) throw Error(ErrorCode::kUnreadable, path, "cannot be read as an image");
  GreyImage image{.width_px = mat.cols, .height_px = mat.rows, .u8 = {}, .u16 = {}, .rgb = {}};
  for (int y = 0; y < mat.rows; ++y) image.u8.insert(image.u8.end(), mat.ptr(y), mat.ptr(y) + mat.cols);
  return image;
}

}  // namespace rilievo::bench
