// The detectors that features_eval compares: the stage's and OpenCV's, called here and nowhere else.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "base/run_context.h"
#include "block/features.h"
#include "block/pixels.h"
#include "stages/features/features.h"

namespace rilievo::bench {

/// The stage's options with all features kept.
features::Options AllFeatures();

/// SIFT of the stage.
ImageFeatures DetectOurs(const GreyImage& image, const features::Options& options, RunContext& context);

/// The same with strips of that width instead of the stage's own, 0 for no strips at all (also where the image is
/// doubled); none while the stage cannot be told.
std::optional<ImageFeatures> DetectOursTiled(const GreyImage& image, const features::Options& options,
                                             int strip_width_px, RunContext& context);

/// The stage's scale space and extrema alone, without orientations and descriptors: their number; none while the stage
/// has no such entry.
std::optional<std::size_t> DetectOursExtremaOnly(const GreyImage& image, const features::Options& options,
                                                 RunContext& context);

/// SURF-128 of the stage, its threshold such that it finds at least `least_features` (found once, outside of the
/// timing); none while the stage has no SURF.
struct SurfChoice {
  features::Options options;
};
std::optional<SurfChoice> ChooseSurf128(const GreyImage& image, std::size_t least_features, RunContext& context);

/// OpenCV's SIFT: 3 layers, sigma 1.6, the image doubled first (its only way).
struct PeerOptions {
  double contrast_threshold = 0.02, edge_threshold = 10;
};
struct PeerCounts {
  std::size_t detected = 0, described = 0;
};
/// Bare calls, for timing: nothing of ours around them. 8-bit images only.
std::size_t PeerDetect(const GreyImage& image, const PeerOptions& options);
std::size_t PeerDetectAndCompute(const GreyImage& image, const PeerOptions& options);

/// In our frame, units and order of fields; descriptors as OpenCV gives them (norm about 512).
ImageFeatures DetectPeer(const GreyImage& image, const PeerOptions& options);

/// The options of `wanted`, its contrast threshold raised as little as gives at most `most_features`.
PeerOptions PeerWithAtMost(const GreyImage& image, const PeerOptions& wanted, std::size_t most_features);

/// RootSIFT of plain descriptors (Arandjelovic & Zisserman 2012), norm 512.
std::vector<Descriptor> RootSift(const std::vector<Descriptor>& plain);

/// The `count` features of greatest response, in their order; ties by index.
ImageFeatures Strongest(const ImageFeatures& features, std::size_t count);

/// Grey image of any format that OpenCV or the stage reads (PGM and PPM by OpenCV). Throws Error.
GreyImage LoadGrey(const std::string& path);

}  // namespace rilievo::bench
