// Sketches, sightings and the growth around verified pairs.
#include "scheduling/guided_pairs.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "base/check.h"

namespace rilievo::scheduling {
namespace {

/// Whether two ascending lists have `least` elements in common.
bool ShareAtLeast(const std::vector<std::uint32_t>& a, const std::vector<std::uint32_t>& b, std::size_t least) {
  std::size_t common = 0, i = 0, j = 0;
  while (i < a.size() && j < b.size() && common < least) {
    if (std::min(a.size() - i, b.size() - j) < least - common) return false;
    if (a[i] == b[j])
      ++common, ++i, ++j;
    else if (a[i] < b[j])
      ++i;
    else
      ++j;
  }
  return common >= least;
}

void SortUnique(std::vector<ImagePair>& pairs) {
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
}

}  // namespace

ImageFeatures Sketch(const ImageFeatures& features, std::size_t count) {
  std::vector<std::uint32_t> chosen(features.keypoints.size());
  std::iota(chosen.begin(), chosen.end(), 0U);
  const auto larger = [&](std::uint32_t a, std::uint32_t b) {
    const float scale_a = features.keypoints[a].scale_px, scale_b = features.keypoints[b].scale_px;
    return scale_a != scale_b ? scale_a > scale_b : a < b;
  };
  if (chosen.size() > count) {
    std::nth_element(chosen.begin(), chosen.begin() + static_cast<std::ptrdiff_t>(count), chosen.end(), larger);
    chosen.resize(count);
    std::sort(chosen.begin(), chosen.end());
  }
  ImageFeatures sketch;
  for (const std::uint32_t i : chosen) {
    sketch.keypoints.push_back(features.keypoints[i]);
    sketch.descriptors.push_back(features.descriptors[i]);
  }
  return sketch;
}

std::uint32_t StrongMatches(std::size_t sketch_a, std::size_t sketch_b) {
  return 6 + static_cast<std::uint32_t>(std::min(sketch_a, sketch_b) / 128);
}

std::vector<ImagePair> StrongPairs(std::span<const Sighting> sightings) {
  std::vector<ImagePair> pairs;
  for (const Sighting& sighting : sightings)
    if (sighting.is_strong) pairs.push_back(sighting.pair);
  SortUnique(pairs);
  return pairs;
}

std::vector<ImagePair> BestPartners(std::span<const Sighting> sightings, std::size_t images, std::size_t count) {
  std::vector<std::vector<const Sighting*>> of_image(images);
  for (const Sighting& sighting : sightings) {
    if (sighting.matches == 0) continue;
    of_image[sighting.pair.first.value].push_back(&sighting);
    of_image[sighting.pair.second.value].push_back(&sighting);
  }
  std::vector<ImagePair> pairs;
  for (auto& seen : of_image) {
    const std::size_t kept = std::min(count, seen.size());
    // Equal matches: the pairs of one image are ordered by the number of the other.
    std::partial_sort(seen.begin(), seen.begin() + static_cast<std::ptrdiff_t>(kept), seen.end(),
                      [](const Sighting* a, const Sighting* b) {
                        return a->matches != b->matches ? a->matches > b->matches : a->pair < b->pair;
                      });
    for (std::size_t i = 0; i < kept; ++i)
      if (!seen[i]->is_strong) pairs.push_back(seen[i]->pair);
  }
  SortUnique(pairs);
  return pairs;
}

CommonFeatures::CommonFeatures(std::size_t images)
    : images_(images), compared_(images * images, false), partners_(images) {}

void CommonFeatures::Add(const TwoViewGeometry& pair) {
  RILIEVO_CHECK(pair.pair.first < pair.pair.second && pair.pair.second.value < images_);
  compared_[Cell(pair.pair.first, pair.pair.second)] = true;
  if (!pair.IsVerified()) return;
  Partner of_first{pair.pair.second, {}}, of_second{pair.pair.first, {}};
  for (const Match& match : pair.inliers) {
    of_first.features.push_back(match.first);
    of_second.features.push_back(match.second);
  }
  std::sort(of_first.features.begin(), of_first.features.end());
  std::sort(of_second.features.begin(), of_second.features.end());
  partners_[pair.pair.first.value].push_back(std::move(of_first));
  partners_[pair.pair.second.value].push_back(std::move(of_second));
}

std::vector<ImagePair> CommonFeatures::Candidates(std::size_t least, RunContext& context) const {
  std::vector<std::vector<ImagePair>> found(images_);  // through each image
  context.ParallelFor(images_, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      context.ThrowIfStopped();
      for (const Partner& a : partners_[k])
        for (const Partner& b : partners_[k])
          if (a.other < b.other && !compared_[Cell(a.other, b.other)] && ShareAtLeast(a.features, b.features, least))
            found[k].push_back({a.other, b.other});
    }
  });
  std::vector<ImagePair> pairs;
  for (const auto& through : found) pairs.insert(pairs.end(), through.begin(), through.end());
  SortUnique(pairs);
  return pairs;
}

std::uint64_t CommonFeatures::Bytes(std::size_t images, std::uint64_t inliers) {
  // Lists grow by doubling; the candidates found through each image, at most a few dozen partners' pairs each.
  return images * images / 8 + 4 * inliers * sizeof(std::uint32_t) + images * 40000;
}

}  // namespace rilievo::scheduling
