// Sketches, sightings and the growth around verified pairs.
#include "scheduling/guided_pairs.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <utility>

#include "base/check.h"

namespace rilievo::scheduling {
namespace {

/// Adds to `features` what `to_a` leads to of the features that are in both lists (sorted by first), until there are
/// `least`; `features` are ascending, each once.
void AddCommon(const std::vector<Match>& to_a, const std::vector<Match>& to_b, std::size_t least,
               std::vector<std::uint32_t>& features) {
  for (std::size_t i = 0, j = 0; i < to_a.size() && j < to_b.size() && features.size() < least;) {
    if (to_a[i].first == to_b[j].first) {
      const std::uint32_t feature = to_a[i++].second;
      const auto place = std::lower_bound(features.begin(), features.end(), feature);
      if (place == features.end() || *place != feature) features.insert(place, feature);
    } else if (to_a[i].first < to_b[j].first) {
      ++i;
    } else {
      ++j;
    }
  }
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
  const auto [first, second] = pair.pair;
  RILIEVO_CHECK(first < second && second.value < images_);
  compared_[Cell(first, second)] = true;
  if (!pair.IsVerified()) return;
  Partner forth{second, pair.inliers}, back{first, pair.inliers};
  for (Match& link : back.links) std::swap(link.first, link.second);
  std::sort(forth.links.begin(), forth.links.end());
  std::sort(back.links.begin(), back.links.end());
  partners_[first.value].push_back(std::move(forth));
  partners_[second.value].push_back(std::move(back));
}

std::vector<ImagePair> CommonFeatures::CandidatesOf(ImageId image, std::size_t least) const {
  std::map<ImageId, std::vector<std::uint32_t>> reached;  // features of `image` that lead to each other one
  for (const Partner& through : partners_[image.value]) {
    const std::vector<Partner>& partners = partners_[through.other.value];
    const auto back = std::find_if(partners.begin(), partners.end(), [&](const auto& p) { return p.other == image; });
    for (const Partner& onwards : partners)
      if (image < onwards.other && !compared_[Cell(image, onwards.other)])
        AddCommon(back->links, onwards.links, least, reached[onwards.other]);
  }
  std::vector<ImagePair> pairs;
  for (const auto& [other, features] : reached)
    if (features.size() >= least) pairs.push_back({image, other});
  return pairs;
}

std::vector<ImagePair> CommonFeatures::Candidates(std::size_t least, RunContext& context) const {
  std::vector<std::vector<ImagePair>> found(images_);
  context.ParallelFor(images_, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      context.ThrowIfStopped();
      found[i] = CandidatesOf(ImageId(static_cast<std::uint32_t>(i)), least);
    }
  });
  std::vector<ImagePair> pairs;  // by first image: sorted
  for (const auto& of_image : found) pairs.insert(pairs.end(), of_image.begin(), of_image.end());
  return pairs;
}

std::uint64_t CommonFeatures::Bytes(std::size_t images, std::uint64_t inliers) {
  // Both directions; partners of partners with up to kLeastCommon features each, of the images at work.
  return images * images / 8 + 2 * inliers * sizeof(Match) + images * 4096;
}

}  // namespace rilievo::scheduling
