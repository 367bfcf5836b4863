// The guided rules on synthetic graphs: what is strong, who is nobody's partner, what verified pairs make likely.
#include "scheduling/guided_pairs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "base/rng.h"

namespace rilievo::scheduling {
namespace {

ImagePair Pair(std::uint32_t a, std::uint32_t b) { return {ImageId(std::min(a, b)), ImageId(std::max(a, b))}; }

TEST(Sketch, KeepsTheLargestInTheirOrder) {
  ImageFeatures features;
  Rng rng(3);
  for (int i = 0; i < 500; ++i) {
    Keypoint keypoint;
    keypoint.scale_px = static_cast<float>(1 + i % 7);  // many equal scales
    keypoint.x_px = static_cast<float>(i);
    features.keypoints.push_back(keypoint);
    Descriptor descriptor{};
    descriptor[0] = static_cast<std::uint8_t>(i % 256);
    features.descriptors.push_back(descriptor);
    features.colors.push_back({});
  }
  const ImageFeatures sketch = Sketch(features, 100);
  ASSERT_EQ(sketch.keypoints.size(), 100U);
  ASSERT_EQ(sketch.descriptors.size(), 100U);
  float least = 100;
  for (std::size_t i = 0; i < 100; ++i) {
    least = std::min(least, sketch.keypoints[i].scale_px);
    EXPECT_EQ(sketch.descriptors[i][0], static_cast<std::uint8_t>(static_cast<int>(sketch.keypoints[i].x_px) % 256));
    if (i > 0) {
      EXPECT_LT(sketch.keypoints[i - 1].x_px, sketch.keypoints[i].x_px);
    }
  }
  const auto larger = std::count_if(features.keypoints.begin(), features.keypoints.end(),
                                    [&](const Keypoint& k) { return k.scale_px > least; });
  EXPECT_LT(larger, 100) << "a larger feature was left out";
  EXPECT_EQ(Sketch(features, 1000).keypoints.size(), 500U);
  EXPECT_TRUE(Sketch({}, 10).keypoints.empty());
}

TEST(BestPartners, EveryImageKeepsItsBestUnlessTheyAreStrongAnyway) {
  constexpr std::size_t kImages = 30, kCount = 3;
  Rng rng(5);
  std::vector<Sighting> sightings;
  for (std::uint32_t a = 0; a < kImages; ++a)
    for (std::uint32_t b = a + 1; b < kImages; ++b) {
      const auto matches = static_cast<std::uint32_t>(rng.Uniform(0, 12));
      sightings.push_back({Pair(a, b), matches, matches >= 9});
    }
  const auto partners = BestPartners(sightings, kImages, kCount);
  const std::set<ImagePair> chosen(partners.begin(), partners.end());
  EXPECT_EQ(chosen.size(), partners.size());
  for (std::uint32_t image = 0; image < kImages; ++image) {
    std::vector<Sighting> own;
    for (const auto& s : sightings)
      if (s.pair.first.value == image || s.pair.second.value == image) own.push_back(s);
    std::stable_sort(own.begin(), own.end(), [](const auto& a, const auto& b) { return a.matches > b.matches; });
    for (std::size_t i = 0; i < kCount; ++i)
      EXPECT_EQ(chosen.contains(own[i].pair), !own[i].is_strong && own[i].matches > 0);
  }
  EXPECT_TRUE(BestPartners(std::vector<Sighting>{{Pair(0, 1), 0, false}}, 2, 4).empty());
}

TEST(StrongPairs, AreThoseSightedStrong) {
  const std::vector<Sighting> sightings{{Pair(2, 5), 90, true}, {Pair(0, 1), 7, false}, {Pair(0, 4), 8, true}};
  EXPECT_EQ(StrongPairs(sightings), (std::vector{Pair(0, 4), Pair(2, 5)}));
  EXPECT_EQ(StrongMatches(512, 10000), 10U);
  EXPECT_EQ(StrongMatches(0, 512), 6U);
}

/// A ring in which image i sees the points [10 i, 10 i + 10 * reach): images d apart share 10 (reach - d) points, none
/// from `reach` on. Features are numbered differently in every image.
class Ring {
 public:
  Ring(std::uint32_t images, std::uint32_t reach) : images_(images), reach_(reach) {}
  std::uint32_t Apart(ImagePair pair) const {
    const std::uint32_t d = pair.second.value - pair.first.value;
    return std::min(d, images_ - d);
  }
  TwoViewGeometry Compare(ImagePair pair) const {
    TwoViewGeometry geometry;
    geometry.pair = pair;
    for (std::uint32_t point = 0; point < 10 * images_; ++point) {
      const auto a = Seen(pair.first.value, point), b = Seen(pair.second.value, point);
      if (a && b) geometry.inliers.push_back({*a, *b});
    }
    std::sort(geometry.inliers.begin(), geometry.inliers.end());
    if (geometry.inliers.size() >= 15)
      geometry.model = TwoViewModel::kEssential;
    else
      geometry.inliers.clear();
    return geometry;
  }
  std::uint32_t images() const { return images_; }

 private:
  std::optional<std::uint32_t> Seen(std::uint32_t image, std::uint32_t point) const {
    const std::uint32_t at = (point + 10 * images_ - 10 * image) % (10 * images_);
    if (at >= 10 * reach_) return std::nullopt;
    return (at * 7 + image) % (10 * reach_ + 3);  // 7 and 10 reach + 3 have no common divisor for reach = 8
  }
  std::uint32_t images_, reach_;
};

TEST(CommonFeatures, GrowsARingFromItsNeighboursToAllThatOverlap) {
  const Ring ring(60, 8);
  SerialRunContext context;
  CommonFeatures common(ring.images());
  std::set<ImagePair> compared;
  const auto compare = [&](ImagePair pair) {
    EXPECT_TRUE(compared.insert(pair).second) << "compared twice";
    common.Add(ring.Compare(pair));
  };
  for (std::uint32_t i = 0; i < ring.images(); ++i) compare(Pair(i, (i + 1) % ring.images()));
  for (auto next = common.Candidates(kLeastCommon, context); !next.empty();
       next = common.Candidates(kLeastCommon, context)) {
    EXPECT_TRUE(std::is_sorted(next.begin(), next.end()));
    for (const ImagePair& pair : next) compare(pair);
  }
  std::size_t true_pairs = 0;
  for (std::uint32_t a = 0; a < ring.images(); ++a)
    for (std::uint32_t b = a + 1; b < ring.images(); ++b) {
      const bool is_true = ring.Compare(Pair(a, b)).inliers.size() >= 30;
      true_pairs += is_true ? 1 : 0;
      if (is_true) {
        EXPECT_TRUE(compared.contains(Pair(a, b))) << a << " " << b;
      }
    }
  EXPECT_EQ(true_pairs, 60U * 5);  // 3 of 8 steps of 10 points shared at least
  EXPECT_LE(compared.size(), true_pairs * 13 / 10);
}

TEST(CommonFeatures, RejectedPairsAreComparedAndLeadNowhere) {
  CommonFeatures common(3);
  TwoViewGeometry left, right;
  left.pair = Pair(0, 1);
  right.pair = Pair(1, 2);
  for (std::uint32_t i = 0; i < 20; ++i) {
    left.inliers.push_back({i, 3 * i});
    right.inliers.push_back({i < 12 ? 3 * i : 3 * i + 1, i});
  }
  left.model = TwoViewModel::kEssential;
  SerialRunContext context;
  common.Add(left);
  CommonFeatures rejected = common;
  rejected.Add(right);
  EXPECT_TRUE(rejected.Candidates(1, context).empty());
  right.model = TwoViewModel::kHomography;
  common.Add(right);
  EXPECT_EQ(common.Candidates(12, context), std::vector{Pair(0, 2)});
  EXPECT_TRUE(common.Candidates(13, context).empty());
  TwoViewGeometry direct;
  direct.pair = Pair(0, 2);
  common.Add(direct);
  EXPECT_TRUE(common.Candidates(1, context).empty());
}

}  // namespace
}  // namespace rilievo::scheduling
