// Tracks against breadth-first search on consistent matches; conflicts and order on random ones.
#include "stages/tracks/tracks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "base/rng.h"

namespace rilievo::tracks {
namespace {

using Elements = std::vector<std::vector<FeatureRef>>;

Elements ElementsOf(const std::vector<Track>& tracks) {
  Elements result;
  for (const Track& t : tracks) result.push_back(t.elements);
  return result;
}

TwoViewGeometry Pair(std::uint32_t first, std::uint32_t second, std::vector<Match> inliers) {
  TwoViewGeometry pair;
  pair.pair = {ImageId(first), ImageId(second)};
  pair.model = TwoViewModel::kEssential;
  std::sort(inliers.begin(), inliers.end());
  pair.inliers = std::move(inliers);
  return pair;
}

Elements Concatenate(const std::vector<TwoViewGeometry>& pairs) {
  SerialRunContext context;
  return ElementsOf(tracks::Run(pairs, context));
}

/// Feature number of point p in an image: scrambled, so that numbers differ from image to image.
std::uint32_t FeatureOf(std::uint32_t image, std::uint32_t point, std::uint32_t points) {
  return (point * 7 + image * 13) % points;
}

/// Pairs of images that see common points; every match survives with a probability. `points` is coprime to 7.
std::vector<TwoViewGeometry> ConsistentPairs(std::uint32_t images, std::uint32_t points, double keep,
                                             std::uint64_t seed) {
  Rng rng(seed);
  std::vector<TwoViewGeometry> pairs;
  for (std::uint32_t i = 0; i < images; ++i) {
    for (std::uint32_t j = i + 1; j < images; ++j) {
      std::vector<Match> inliers;
      for (std::uint32_t p = 0; p < points; ++p) {
        if (rng.Uniform() < keep) inliers.push_back({FeatureOf(i, p, points), FeatureOf(j, p, points)});
      }
      if (rng.Uniform() < 0.7) pairs.push_back(Pair(i, j, inliers));
    }
  }
  return pairs;
}

/// Random matches, one-to-one in each pair but full of contradictions over several.
std::vector<TwoViewGeometry> RandomPairs(std::uint32_t images, std::uint32_t features, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<TwoViewGeometry> pairs;
  for (std::uint32_t i = 0; i < images; ++i) {
    for (std::uint32_t j = i + 1; j < images; ++j) {
      std::vector<Match> inliers;
      std::set<std::uint32_t> used;
      for (std::uint32_t f = 0; f < features; ++f) {
        const std::uint32_t g = rng.Below(features);
        if (rng.Uniform() < 0.3 && used.insert(g).second) inliers.push_back({f, g});
      }
      pairs.push_back(Pair(i, j, inliers));
    }
  }
  return pairs;
}

/// Connected components by repeated relabelling, O(n^2).
Elements ComponentsOracle(const std::vector<TwoViewGeometry>& pairs) {
  std::map<FeatureRef, FeatureRef> label;
  for (const auto& p : pairs) {
    for (const Match& m : p.inliers) {
      label.try_emplace({p.pair.first, m.first}, FeatureRef{p.pair.first, m.first});
      label.try_emplace({p.pair.second, m.second}, FeatureRef{p.pair.second, m.second});
    }
  }
  for (bool has_changed = true; has_changed;) {
    has_changed = false;
    for (const auto& p : pairs) {
      for (const Match& m : p.inliers) {
        FeatureRef &a = label[{p.pair.first, m.first}], &b = label[{p.pair.second, m.second}];
        if (a == b) continue;
        a = b = std::min(a, b);
        has_changed = true;
      }
    }
  }
  std::map<FeatureRef, std::vector<FeatureRef>> groups;
  for (const auto& [element, root] : label) groups[root].push_back(element);
  Elements result;
  for (auto& [root, elements] : groups) result.push_back(elements);
  return result;
}

/// The contract word for word: edges in order, sets as plain vectors.
Elements GreedyOracle(std::vector<TwoViewGeometry> pairs) {
  std::stable_sort(pairs.begin(), pairs.end(), [](const auto& a, const auto& b) {
    return a.inliers.size() != b.inliers.size() ? a.inliers.size() > b.inliers.size()
           : a.pair != b.pair                   ? a.pair < b.pair
                                                : a.inliers < b.inliers;
  });
  Elements sets;
  const auto find = [&](const FeatureRef& element) {
    for (std::size_t s = 0; s < sets.size(); ++s) {
      if (std::find(sets[s].begin(), sets[s].end(), element) != sets[s].end()) return s;
    }
    sets.push_back({element});
    return sets.size() - 1;
  };
  for (const auto& p : pairs) {
    for (const Match& m : p.inliers) {
      const std::size_t a = find({p.pair.first, m.first}), b = find({p.pair.second, m.second});
      if (a == b) continue;
      std::set<ImageId> images;
      for (const std::size_t s : {a, b}) {
        for (const FeatureRef& e : sets[s]) images.insert(e.image);
      }
      if (images.size() != sets[a].size() + sets[b].size()) continue;
      sets[a].insert(sets[a].end(), sets[b].begin(), sets[b].end());
      sets.erase(sets.begin() + static_cast<std::ptrdiff_t>(b));
    }
  }
  std::erase_if(sets, [](const auto& s) { return s.size() < 2; });
  for (auto& s : sets) std::sort(s.begin(), s.end());
  std::sort(sets.begin(), sets.end());
  return sets;
}

TEST(Tracks, ConsistentMatchesGiveTheConnectedComponents) {
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    const auto pairs =
        ConsistentPairs(8, 60 + static_cast<std::uint32_t>(seed % 2), 0.15 + 0.05 * static_cast<double>(seed), seed);
    EXPECT_EQ(Concatenate(pairs), ComponentsOracle(pairs)) << seed;
  }
}

TEST(Tracks, ContradictionsAreRefusedByDescendingSupport) {
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    const auto pairs = RandomPairs(6, 25, seed);
    const Elements tracks = Concatenate(pairs);
    EXPECT_EQ(tracks, GreedyOracle(pairs)) << seed;
    std::set<FeatureRef> seen;
    for (const auto& elements : tracks) {
      EXPECT_GE(elements.size(), 2U);
      std::set<ImageId> images;
      for (const FeatureRef& e : elements) {
        EXPECT_TRUE(images.insert(e.image).second) << "two features of one image";
        EXPECT_TRUE(seen.insert(e).second) << "one feature in two tracks";
      }
    }
  }
}

TEST(Tracks, LongTracksFollowTheSameRule) {
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    auto pairs = ConsistentPairs(90, 8 + static_cast<std::uint32_t>(seed % 2), 0.02 + 0.03 * static_cast<double>(seed),
                                 70 + seed);
    for (const auto& wrong : RandomPairs(90, 2, 80 + seed)) {
      if (wrong.pair.second.value % 9 == 0) pairs.push_back(wrong);
    }
    const Elements tracks = Concatenate(pairs);
    EXPECT_EQ(tracks, GreedyOracle(pairs)) << seed;
    EXPECT_TRUE(std::any_of(tracks.begin(), tracks.end(), [](const auto& t) { return t.size() > 40; }));
  }
}

TEST(Tracks, TheOrderOfThePairsDoesNotMatter) {
  auto pairs = RandomPairs(7, 40, 50);
  pairs.push_back(pairs.front());  // the same pair again with other matches
  pairs.back().inliers.resize(pairs.back().inliers.size() / 2);
  const Elements expected = Concatenate(pairs);
  ASSERT_FALSE(expected.empty());
  Rng rng(51);
  for (int round = 0; round < 20; ++round) {
    for (std::uint32_t i = static_cast<std::uint32_t>(pairs.size()); i-- > 1;)
      std::swap(pairs[i], pairs[rng.Below(i + 1)]);
    ASSERT_EQ(Concatenate(pairs), expected);
  }
}

TEST(Tracks, RejectedPairsAndEmptyInputGiveNothing) {
  EXPECT_TRUE(Concatenate({}).empty());
  auto rejected = Pair(0, 1, {{0, 0}, {1, 1}});
  rejected.model = TwoViewModel::kRejected;
  EXPECT_TRUE(Concatenate({rejected, Pair(2, 3, {})}).empty());
}

TEST(Tracks, TheEstimateCoversTheTracksAlone) {
  const auto pairs = ConsistentPairs(5, 1000, 0.9, 60);
  std::size_t matches = 0;
  for (const auto& p : pairs) matches += p.inliers.size();
  std::uint64_t held = 0;
  for (const auto& elements : Concatenate(pairs)) held += sizeof(Track) + elements.size() * sizeof(FeatureRef);
  EXPECT_GT(Estimate(matches).peak_bytes, held);
  std::size_t features = 0;
  for (const auto& elements : Concatenate(pairs)) features += elements.size();
  EXPECT_GT(Estimate(matches, features).peak_bytes, held);
  EXPECT_LT(Estimate(matches, features).peak_bytes, Estimate(matches).peak_bytes);
}

TEST(Tracks, AStopRequestEndsALongRun) {
  class Stopped : public SerialRunContext {
    bool StopRequested() const override { return true; }
  } context;
  EXPECT_THROW(tracks::Run(ConsistentPairs(12, 5000, 0.9, 61), context), Cancelled);
}

}  // namespace
}  // namespace rilievo::tracks
