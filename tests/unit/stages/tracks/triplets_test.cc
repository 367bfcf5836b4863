// Checked triplets against exact scenes: planted false matches go, true ones stay, ends close.
#include "stages/tracks/triplets.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "tests/support/synthetic_block.h"

namespace rilievo::tracks {
namespace {

using test::Layout;
using test::MakeSyntheticBlock;
using test::Object;
using test::SyntheticBlock;

SyntheticBlock Sequence(Layout layout, int images, double noise_px, int points = 1500) {
  return MakeSyntheticBlock({.layout = layout,
                             .object = layout == Layout::kRing ? Object::kSphere : Object::kRelief,
                             .images = images,
                             .points = points,
                             .noise_px = noise_px,
                             .sequence_window = 2});
}

SequenceMatches Check(const SyntheticBlock& b, bool closed = false) {
  SerialRunContext context(7);
  const auto triplets = SequenceTriplets(b.block.images.size(), closed);
  return CheckTriplets({b.block, b.keypoints, b.pairs, triplets}, {}, context);
}

TwoViewGeometry& PairOf(SyntheticBlock& b, std::uint32_t i, std::uint32_t j) {
  return *std::find_if(b.pairs.begin(), b.pairs.end(), [&](const auto& g) {
    return g.pair == ImagePair{ImageId(i), ImageId(j)};
  });
}

/// Moves a share of the features 25 to 60 px: half of them along the epipolar line of the image before, where no check
/// of two views can see it. One of a track at most: two can agree on another point by chance, which is no error of
/// three views to find.
std::set<FeatureRef> MoveFeatures(SyntheticBlock& b, double share) {
  Rng rng(99);
  std::set<FeatureRef> moved;
  for (std::size_t t = 0; t < b.tracks.size(); ++t)
    for (const FeatureRef& e : b.tracks[t].elements) {
      if (rng.Uniform() >= share) continue;
      Keypoint& keypoint = b.keypoints[e.image.value][e.feature];
      Eigen::Vector2d direction(rng.Normal(), rng.Normal());
      if (e.image.value > 0 && rng.Uniform() < 0.5) {
        const Eigen::Vector3d point = b.points[b.point_of_track[t]];
        const Eigen::Vector3d ray = point - b.cam_from_world[e.image.value - 1].Center();
        const CameraModel& camera = b.block.cameras[0].model;
        const Rigid3& pose = b.cam_from_world[e.image.value];
        direction = *camera.Project(pose * (point + 0.01 * ray)) - *camera.Project(pose * point);
      }
      const Eigen::Vector2d step = rng.Uniform(25, 60) * direction.normalized();
      keypoint.x_px += static_cast<float>(step.x());
      keypoint.y_px += static_cast<float>(step.y());
      moved.insert(e);
      break;
    }
  return moved;
}

/// Matches of the true loops of a sequence, from the tracks of the scene: pair, features.
std::set<std::pair<ImagePair, Match>> TrueMatches(const SyntheticBlock& b, const std::vector<Triplet>& triplets,
                                                  const std::set<FeatureRef>& moved) {
  std::set<std::pair<ImagePair, Match>> matches;
  for (const Track& track : b.tracks) {
    std::map<ImageId, std::uint32_t> at;
    for (const FeatureRef& e : track.elements)
      if (!moved.contains(e)) at[e.image] = e.feature;
    for (const Triplet& t : triplets) {
      if (!at.contains(t[0]) || !at.contains(t[1]) || !at.contains(t[2])) continue;
      for (const auto& [x, y] : {std::pair{t[0], t[1]}, std::pair{t[1], t[2]}, std::pair{t[0], t[2]}})
        matches.insert({{std::min(x, y), std::max(x, y)}, {at[std::min(x, y)], at[std::max(x, y)]}});
    }
  }
  return matches;
}

std::set<std::pair<ImagePair, Match>> UsedMatches(const SequenceMatches& result) {
  std::set<std::pair<ImagePair, Match>> used;
  for (const auto& g : result.pairs) {
    EXPECT_TRUE(std::is_sorted(g.inliers.begin(), g.inliers.end()));
    for (const Match& m : g.inliers) EXPECT_TRUE(used.insert({g.pair, m}).second) << "a match twice";
  }
  return used;
}

TEST(Triplets, TheFalseGoAndTheTrueStay) {
  for (const bool closed : {false, true}) {
    SyntheticBlock b = Sequence(closed ? Layout::kRing : Layout::kArc, closed ? 14 : 9, 0.4);
    const auto moved = MoveFeatures(b, 0.06);
    const SequenceMatches result = Check(b, closed);
    const auto used = UsedMatches(result);
    std::size_t false_used = 0, true_used = 0;
    for (const auto& [pair, match] : used)
      false_used += moved.contains({pair.first, match.first}) || moved.contains({pair.second, match.second});
    const auto expected = TrueMatches(b, SequenceTriplets(b.block.images.size(), closed), moved);
    for (const auto& match : expected) true_used += used.contains(match);
    ASSERT_GT(expected.size(), 3000U);
    EXPECT_EQ(false_used, 0U) << closed;
    EXPECT_GE(static_cast<double>(true_used), 0.99 * static_cast<double>(expected.size())) << closed;
    EXPECT_EQ(used.size(), true_used) << "matches that no loop holds";
    EXPECT_GT(result.summary.failed_loops, result.summary.loops / 10);
    EXPECT_EQ(result.summary.weak, 0U);
    EXPECT_EQ(result.summary.matches_used, used.size());
  }
}

TEST(Triplets, ExactMatchesAllStay) {
  const SyntheticBlock b = Sequence(Layout::kArc, 6, 0);
  const SequenceMatches result = Check(b);
  EXPECT_EQ(result.summary.triplets, 4U);
  EXPECT_EQ(result.summary.unchecked, 0U);
  EXPECT_EQ(result.summary.failed_loops, 0U);
  EXPECT_EQ(UsedMatches(result), TrueMatches(b, SequenceTriplets(6, false), {}));
}

TEST(Triplets, WithoutABaseTheLoopsDecide) {
  SyntheticBlock b = MakeSyntheticBlock({.layout = Layout::kRotation, .images = 5, .sequence_window = 2});
  MoveFeatures(b, 0.05);
  const SequenceMatches result = Check(b);
  EXPECT_EQ(result.summary.unchecked, 3U);
  EXPECT_EQ(result.summary.failed_loops, 0U);
  EXPECT_EQ(UsedMatches(result), TrueMatches(b, SequenceTriplets(5, false), {}));
}

TEST(Triplets, AWeakTripletStillCarriesItsRows) {
  SyntheticBlock b = Sequence(Layout::kArc, 7, 0.3);
  TwoViewGeometry& skipped = PairOf(b, 2, 4);  // triplet 2-3-4 has no loop
  skipped.model = TwoViewModel::kRejected;
  skipped.inliers.clear();
  const SequenceMatches result = Check(b);
  EXPECT_EQ(result.summary.weak, 1U);
  EXPECT_EQ(result.summary.poor_images, 0U);
  const auto used = UsedMatches(result);
  std::size_t rows = 0;
  for (const Track& track : b.tracks) {
    std::map<ImageId, std::uint32_t> at;
    for (const FeatureRef& e : track.elements) at[e.image] = e.feature;
    if (!at.contains(ImageId(2)) || !at.contains(ImageId(3)) || !at.contains(ImageId(4))) continue;
    ++rows;
    EXPECT_TRUE(used.contains({{ImageId(2), ImageId(3)}, {at[ImageId(2)], at[ImageId(3)]}}));
    EXPECT_TRUE(used.contains({{ImageId(3), ImageId(4)}, {at[ImageId(3)], at[ImageId(4)]}}));
  }
  EXPECT_GT(rows, 200U);
}

TEST(Triplets, APoorImageGetsTheMatchesOfItsPairs) {
  SyntheticBlock b = Sequence(Layout::kArc, 6, 0.3);
  for (const std::uint32_t other : {3U, 4U}) PairOf(b, other, 5).inliers.resize(other == 4 ? 60 : 0);
  const SequenceMatches result = Check(b);
  EXPECT_EQ(result.summary.weak, 1U);
  const auto used = UsedMatches(result);
  for (const Match& m : PairOf(b, 4, 5).inliers) EXPECT_TRUE(used.contains({{ImageId(4), ImageId(5)}, m}));

  SyntheticBlock two = Sequence(Layout::kArc, 3, 0.3);  // one pair alone is verified
  for (const std::uint32_t first : {0U, 1U}) {
    PairOf(two, first, 2).model = TwoViewModel::kRejected;
    PairOf(two, first, 2).inliers.clear();
  }
  EXPECT_EQ(Check(two).summary.poor_images, 3U);
  EXPECT_EQ(UsedMatches(Check(two)).size(), PairOf(two, 0, 1).inliers.size());
}

TEST(Triplets, FeaturesAtOnePositionAreOne) {
  SyntheticBlock b = Sequence(Layout::kArc, 3, 0.3);
  const auto expected = Check(b).summary;
  // Each feature of the middle image twice, the copy a little off; the pair towards the third image knows the copies.
  const auto count = static_cast<std::uint32_t>(b.keypoints[1].size());
  for (std::uint32_t f = 0; f < count; ++f) {
    b.keypoints[1].push_back(b.keypoints[1][f]);
    b.keypoints[1].back().x_px += 0.06F;
  }
  for (Match& m : PairOf(b, 1, 2).inliers) m.first += count;
  const SequenceMatches result = Check(b);
  EXPECT_EQ(result.summary.loops, expected.loops);
  EXPECT_EQ(result.summary.matches_used, expected.matches_used);
  SerialRunContext context;
  std::size_t long_tracks = 0;
  for (const Track& track : tracks::Run(result.pairs, context)) long_tracks += track.elements.size() == 3;
  EXPECT_GE(long_tracks, expected.loops - expected.failed_loops - 5);
}

TEST(Triplets, TracksGrowAlongTheSequenceAndAcrossItsEnd) {
  SyntheticBlock b = Sequence(Layout::kRing, 16, 0.2, 3000);
  SerialRunContext context;
  const auto across = [&](bool closed) {
    std::size_t count = 0, longest = 0;
    for (const Track& t : tracks::Run(Check(b, closed).pairs, context)) {
      longest = std::max(longest, t.elements.size());
      count += t.elements.front().image == ImageId(0) && t.elements.back().image == ImageId(15);
    }
    EXPECT_GE(longest, 5U);
    return count;
  };
  EXPECT_EQ(across(false), 0U);
  EXPECT_GT(across(true), 100U);
  EXPECT_EQ(UsedMatches(Check(b, true)), UsedMatches(Check(b, true)));
}

TEST(Triplets, CountOfASequence) {
  for (std::size_t n = 0; n < 12; ++n) {
    EXPECT_EQ(SequenceTriplets(n, false).size(), n < 3 ? 0 : n - 2);
    EXPECT_EQ(SequenceTriplets(n, true).size(), n < 3 ? 0 : n == 3 ? 1 : n);
  }
}

}  // namespace
}  // namespace rilievo::tracks
