// Which pairs of a guided block are worth a full comparison (docs/decisions/0012-pair-selection.md).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/run_context.h"
#include "block/features.h"
#include "block/pair.h"

namespace rilievo::scheduling {

/// Bumped whenever other pairs would be chosen from the same features: part of the keys of guided blocks.
inline constexpr int kGuidedVersion = 1;

/// Images a side of a tile of the visibility map: a multiple of every TileEdge.
inline constexpr std::size_t kVisibilityEdge = 16;

/// The `count` largest features by scale, in their order, without colours; all of them where there are fewer.
ImageFeatures Sketch(const ImageFeatures& features, std::size_t count);

/// What the fast pass saw of a pair: matches between the sketches.
struct Sighting {
  ImagePair pair;
  std::uint32_t matches = 0;
  bool is_strong = false;  ///< more than sketches of images that share nothing have
};

/// Matches that make a sighting strong: 6 and one for 128 features of the smaller sketch. Unrelated sketches of 512
/// have two or three mutual matches by chance and hardly ever more than 10, of 1024 four and 14.
std::uint32_t StrongMatches(std::size_t sketch_a, std::size_t sketch_b);

/// The pairs that are strong, sorted.
std::vector<ImagePair> StrongPairs(std::span<const Sighting> sightings);

/// The pairs of each image with the `count` others that it has most matches with (at least one; equals: the lower
/// number), strong ones left out; sorted. So that an image of little texture, or in a block of chance matches only, is
/// not left alone.
std::vector<ImagePair> BestPartners(std::span<const Sighting> sightings, std::size_t images, std::size_t count);
inline constexpr std::size_t kBestPartners = 4;

/// What the full comparison of pairs says about pairs that were not compared: images that share features through
/// others, each step of it verified, most likely share them directly.
class CommonFeatures {
 public:
  explicit CommonFeatures(std::size_t images);

  /// A pair that was compared, with its inliers when it was verified.
  void Add(const TwoViewGeometry& pair);

  /// The pairs not compared yet of which `least` different features of the first image or more lead to the second
  /// through some third image; sorted. Work: images * (partners of an image)^2 * inliers of a pair.
  std::vector<ImagePair> Candidates(std::size_t least, RunContext& context) const;

  /// Memory for so many inliers in all verified pairs.
  static std::uint64_t Bytes(std::size_t images, std::uint64_t inliers);

 private:
  struct Partner {
    ImageId other;
    std::vector<Match> links;  ///< first: feature of the image whose partner this is, ascending; second: of `other`
  };
  std::size_t Cell(ImageId a, ImageId b) const { return a.value * images_ + b.value; }
  std::vector<ImagePair> CandidatesOf(ImageId image, std::size_t least) const;

  std::size_t images_;
  std::vector<bool> compared_;  ///< images x images, first < second
  std::vector<std::vector<Partner>> partners_;
};
/// (decision 0012)
inline constexpr std::size_t kLeastCommon = 20;

}  // namespace rilievo::scheduling
