// Keypoints and descriptors of one image: the stage, whatever the detector.
#include "stages/features/features.h"

#include <algorithm>
#include <array>
#include <vector>

#include "base/check.h"
#include "stages/features/gloh.h"
#include "stages/features/kernel_choice.h"
#include "stages/features/pca_sift.h"
#include "stages/features/selection.h"
#include "stages/features/sift.h"
#include "stages/features/surf.h"

namespace rilievo::features {
namespace {

/// The kernels of this processor or of RILIEVO_KERNELS, read once.
const SiftKernels& ProcessKernels() {
  static const SiftKernels& kernels = ChooseSiftKernels(ForcedKernels());
  return kernels;
}

SelectionRule RuleOf(int width_px, int height_px, const Options& options) {
  return {static_cast<std::size_t>(std::max(1, options.max_features)), options.choice == "spread", width_px, height_px};
}

Describer DescriberOf(const Options& options) {
  if (options.detector == "gloh") return DescribeGloh;
  if (options.detector == "pca-sift") return DescribePcaSift;
  return SiftDescriber(options.root_sift);
}

SiftOptions SiftOptionsOf(const Options& options) {
  return {options.first_octave,
          {options.contrast_threshold, options.edge_threshold},
          options.octaves,
          DescriberOf(options)};
}

bool IsSurf(const Options& options) { return options.detector.find("surf") != std::string::npos; }

SurfOptions SurfOptionsOf(const Options& options) {
  return {options.hessian_threshold, options.detector == "surf-128" ? 128 : 64, options.detector == "u-surf-64"};
}

std::vector<Feature> Detect(const Input& input, const Options& options, const SelectionRule& rule,
                            RunContext& context) {
  if (!IsSurf(options)) return DetectSift(input, SiftOptionsOf(options), rule, ProcessKernels(), context);
  std::vector<Feature> features = DetectSurf(input, SurfOptionsOf(options), input.tiling, context);
  if (!input.mask.empty())
    std::erase_if(features, [&](const Feature& f) { return !IsUsed(input, f.keypoint.x_px, f.keypoint.y_px); });
  return features;
}

Rgb ColorAt(const GreyImage& image, const Keypoint& keypoint) {
  const std::size_t pixel = PixelUnder(image, keypoint.x_px, keypoint.y_px);
  if (!image.rgb.empty()) return {image.rgb[3 * pixel], image.rgb[3 * pixel + 1], image.rgb[3 * pixel + 2]};
  const auto grey = static_cast<std::uint8_t>(image.Is16Bit() ? image.u16[pixel] >> 8 : image.u8[pixel]);
  return {grey, grey, grey};
}

}  // namespace

std::span<const OptionDeclaration<Options>> OptionDeclarations() {
  // Positional, all fields given: g++ 12 fails on designated initialisers of this template.
  static const std::vector<OptionDeclaration<Options>> declarations = {
      {"detector",
       &Options::detector,
       0,
       0,
       "",
       "detector and descriptor; gloh and pca-sift describe the features of sift",
       {"sift", "gloh", "pca-sift", "surf-64", "surf-128", "u-surf-64"}},
      {"max-features",
       &Options::max_features,
       1,
       1 << 20,
       "features an image",
       "keep at most this number of features of an image",
       {}},
      {"feature-choice",
       &Options::choice,
       0,
       0,
       "",
       "which features are kept: the strongest, or the strongest of each part of the image first",
       {"strongest", "spread"}},
      {"first-octave",
       &Options::first_octave,
       -1,
       0,
       "",
       "-1 doubles the image before features are looked for, 0 does not: fewer and larger features, four times as fast",
       {}},
      {"octaves",
       &Options::octaves,
       1,
       20,
       "",
       "octaves that are searched at most; larger features locate a point less well",
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
      {"hessian-threshold",
       &Options::hessian_threshold,
       0.01,
       10000,
       "grey levels^2",
       "SURF: least determinant of the Hessian; lower it for weak texture",
       {}},
  };
  return declarations;
}

bool ComparesEqualSignsOnly(const Options& options) { return IsSurf(options); }

TaskCost Estimate(int width_px, int height_px, int bits_per_sample, const Options& options, const Tiling& tiling) {
  const int width = std::max(width_px, 0), height = std::max(height_px, 0);
  const auto pixels = static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  const SelectionRule rule = RuleOf(std::max(1, width), std::max(1, height), options);
  // SURF gathers all features before the cut: twice what noise has, one in 50 pixels.
  const std::uint64_t held = IsSurf(options) ? SurfPeakBytes(width, tiling) + pixels / 25 * sizeof(Feature)
                                             : SiftBytesHeld(width, height, SiftOptionsOf(options), rule, tiling);
  // Decoding included; AVX-512, two photographs at once.
  const double work_s_per_px = IsSurf(options) || options.first_octave >= 0 ? 0.033e-6 : 0.10e-6;
  return {.peak_bytes = (4 << 20) + (bits_per_sample > 8 ? 5 : 4) * pixels + held,
          .work = work_s_per_px * static_cast<double>(pixels)};
}

Tiling ChooseTiling(int width_px, int height_px, int bits_per_sample, const Options& options,
                    std::uint64_t budget_bytes) {
  // SURF's halo is six times that of SIFT: wider strips waste less.
  constexpr std::array<Tiling, 6> kTilings = {{{1024, 8}, {512, 8}, {512, 4}, {512, 2}, {512, 1}, {128, 1}}};
  for (const Tiling& tiling : kTilings) {
    if (tiling.strip_width_px > 512 && !IsSurf(options)) continue;
    if (Estimate(width_px, height_px, bits_per_sample, options, tiling).peak_bytes <= budget_bytes) return tiling;
  }
  return kTilings.back();
}

ImageFeatures Run(const Input& input, const Options& options, RunContext& context) {
  const GreyImage& image = input.image;
  const std::size_t pixels = static_cast<std::size_t>(image.width_px) * static_cast<std::size_t>(image.height_px);
  RILIEVO_CHECK(image.width_px >= 0 && image.height_px >= 0);
  RILIEVO_CHECK((image.Is16Bit() ? image.u16.size() : image.u8.size()) == pixels);
  RILIEVO_CHECK(image.rgb.empty() || image.rgb.size() == 3 * pixels);
  RILIEVO_CHECK(input.mask.empty() || input.mask.size() == pixels);
  context.ThrowIfStopped();
  if (pixels == 0) return {};

  const SelectionRule rule = RuleOf(image.width_px, image.height_px, options);
  const std::vector<Feature> features = SelectFeatures(Detect(input, options, rule, context), rule);
  ImageFeatures result;
  result.keypoints.reserve(features.size());
  result.descriptors.reserve(features.size());
  result.colors.reserve(features.size());
  for (const Feature& feature : features) {
    result.keypoints.push_back(feature.keypoint);
    result.descriptors.push_back(feature.descriptor);
    result.colors.push_back(ColorAt(image, feature.keypoint));
  }
  return result;
}

}  // namespace rilievo::features
