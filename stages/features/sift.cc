// SIFT keypoints and descriptors of one image (Lowe 2004), by own kernels in strips of bounded memory.
#include "stages/features/sift.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "stages/features/descriptor_bytes.h"

namespace rilievo::features {
namespace {

/// The last octave that can hold a feature.
constexpr int kSmallestOctave_px = 2 * kBorder_px + 1;

/// Layer units a grey value. A full 16-bit range fills that of the layers. 10-, 12- and 14-bit data in 16-bit files are
/// raised by the bits that the brightest pixel leaves unused: contrasts are then those they would have among 8-bit
/// images.
float GainOf(const GreyImage& image) {
  if (!image.Is16Bit()) return kUnitsPerLevel;
  const std::uint16_t brightest = *std::max_element(image.u16.begin(), image.u16.end());
  int shift = 0;
  while (shift < 8 && (brightest << shift) < 32768) ++shift;
  return static_cast<float>(1 << shift);
}

}  // namespace

Describer SiftDescriber(bool root) {
  return [root](const SiftKernels& kernels, const Patch& patch, float cosine, float sine) {
    alignas(64) float histogram[128];
    kernels.describe(patch, cosine, sine, histogram);
    return SiftBytes(histogram, root);
  };
}

std::vector<Feature> DetectSift(const Input& input, const SiftOptions& options, const SelectionRule& rule,
                                const SiftKernels& kernels, RunContext& context) {
  const GreyImage& image = input.image;
  FeatureCollector features(rule);
  if (image.width_px < 1 || image.height_px < 1) return {};
  OctaveInput octave{.source = input};
  octave.index = options.first_octave;
  octave.width_px = options.first_octave < 0 ? 2 * image.width_px : image.width_px;
  octave.height_px = options.first_octave < 0 ? 2 * image.height_px : image.height_px;
  octave.gain = GainOf(image);
  Plane base;
  const int end = options.first_octave + options.octaves;
  while (octave.index < end && std::min(octave.width_px, octave.height_px) >= kSmallestOctave_px) {
    OctaveOutput output = RunOctave(octave, options.thresholds, options.describe, rule, kernels, context);
    features.Add(std::move(output.features));
    base = std::move(output.next);
    octave.base = &base;
    octave.width_px = base.width_px;
    octave.height_px = base.height_px;
    ++octave.index;
  }
  return features.Take();
}

std::size_t SiftBytesHeld(int width_px, int height_px, const SiftOptions& options, const SelectionRule& rule,
                          const Tiling& tiling) {
  const auto pixels = static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px);
  // The image of the second octave, and that of the third while it is made.
  const std::size_t planes = options.first_octave < 0 ? 2 * (pixels + pixels / 4) : 2 * (pixels / 4 + pixels / 16);
  const int octave_width_px = options.first_octave < 0 ? 2 * width_px : width_px;
  // Collectors of all chunks, of the octave and of the image; a feature covers some pixels (an extremum has 80
  // neighbours that are none), so that small images have few.
  const std::size_t features = std::min(
      (static_cast<std::size_t>(tiling.chunks) + 2) * FeatureCollector::MostBytes(rule), pixels / 4 * sizeof(Feature));
  return planes + OctaveWorkspaceBytes(octave_width_px, tiling) + features;
}

}  // namespace rilievo::features
