// Matching against a brute-force double loop, through every kernel that this processor has.
#include "stages/matching/matching.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <tuple>

#include "base/rng.h"
#include "stages/matching/two_nearest.h"

namespace rilievo::matching {
namespace {

using Descriptors = std::vector<Descriptor>;

Descriptors RandomSift(std::size_t count, std::uint64_t seed) {
  Rng rng(seed);
  Descriptors result(count);
  for (auto& descriptor : result) {
    std::array<double, 128> values{};
    double norm_sq = 0;
    for (double& v : values) {
      v = std::abs(rng.Normal());
      norm_sq += v * v;
    }
    for (std::size_t k = 0; k < 128; ++k) {
      descriptor[k] = static_cast<std::uint8_t>(std::min(255.0, std::round(512 * values[k] / std::sqrt(norm_sq))));
    }
  }
  return result;
}

/// Few distinct descriptors of few values: ties and duplicates everywhere.
Descriptors RandomTies(std::size_t count, std::uint64_t seed) {
  Rng rng(seed);
  Descriptors result(count);
  for (auto& descriptor : result) {
    const std::uint32_t pattern = rng.Below(7);
    for (std::size_t k = 0; k < 128; ++k)
      descriptor[k] = static_cast<std::uint8_t>(k % 7 == pattern ? 40 + rng.Below(2) * (k == 21) : 40);
  }
  return result;
}

Descriptors RandomBytes(std::size_t count, std::uint64_t seed, std::uint32_t low, std::uint32_t high) {
  Rng rng(seed);
  Descriptors result(count);
  for (auto& descriptor : result) {
    for (auto& v : descriptor) v = static_cast<std::uint8_t>(low + rng.Below(high - low + 1));
  }
  return result;
}

/// Neighbours of every a in b by a full sort of (squared distance, index).
std::vector<BestTwo> BruteForce(const Descriptors& a, const Descriptors& b) {
  std::vector<BestTwo> result(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::vector<std::pair<std::int32_t, std::uint32_t>> all;
    for (std::uint32_t j = 0; j < b.size(); ++j) {
      std::int32_t distance_sq = 0;
      for (std::size_t k = 0; k < 128; ++k) distance_sq += (a[i][k] - b[j][k]) * (a[i][k] - b[j][k]);
      all.emplace_back(distance_sq, j);
    }
    std::sort(all.begin(), all.end());
    if (!all.empty()) result[i].first_sq = all[0].first, result[i].index = all[0].second;
    if (all.size() > 1) result[i].second_sq = all[1].first;
  }
  return result;
}

void ExpectEqualTables(const std::vector<BestTwo>& found, const std::vector<BestTwo>& expected,
                       const std::string& what) {
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    ASSERT_EQ(found[i].first_sq, expected[i].first_sq) << what << " " << i;
    ASSERT_EQ(found[i].second_sq, expected[i].second_sq) << what << " " << i;
    if (expected[i].first_sq != BestTwo::kNone) {
      ASSERT_EQ(found[i].index, expected[i].index) << what << " " << i;
    }
  }
}

class MatchingKernels : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    for (const Kernel& kernel : AllKernels()) {
      if (kernel.name == GetParam()) kernel_ = &kernel;
    }
    ASSERT_NE(kernel_, nullptr);
    if (!kernel_->is_supported) GTEST_SKIP() << "this processor has no " << GetParam();
  }
  void ExpectBruteForce(const Descriptors& a, const Descriptors& b) {
    SerialRunContext context;
    const NeighborTable table = FindTwoNearest(a, b, *kernel_, context);
    const std::string sizes = GetParam() + " " + std::to_string(a.size()) + "x" + std::to_string(b.size());
    ExpectEqualTables(table.of_a, BruteForce(a, b), sizes + " rows");
    ExpectEqualTables(table.of_b, BruteForce(b, a), sizes + " columns");
  }
  const Kernel* kernel_ = nullptr;
};

TEST_P(MatchingKernels, SizesAroundTheBlocks) {
  for (const std::size_t na : {0, 1, 2, 3, 5, 6, 7, 11, 13}) {
    for (const std::size_t nb : {0, 1, 2, 15, 16, 17, 63, 64, 65, 130})
      ExpectBruteForce(RandomSift(na, na), RandomSift(nb, 100 + nb));
  }
}

TEST_P(MatchingKernels, SeveralRowBlocks) { ExpectBruteForce(RandomSift(2021, 1), RandomSift(197, 2)); }

TEST_P(MatchingKernels, TiesGoToTheLowerIndex) {
  ExpectBruteForce(RandomTies(301, 3), RandomTies(517, 4));
  const Descriptors same = RandomSift(70, 5);
  Descriptors twice = same;
  twice.insert(twice.end(), same.begin(), same.end());
  ExpectBruteForce(twice, twice);
}

TEST_P(MatchingKernels, AnyBytes) {
  ExpectBruteForce(RandomBytes(90, 6, 0, 255), RandomBytes(133, 7, 0, 255));
  ExpectBruteForce(RandomBytes(31, 8, 254, 255), RandomBytes(70, 9, 0, 1));  // largest distances
  ExpectBruteForce(Descriptors(9, Descriptor{}), RandomBytes(70, 10, 255, 255));
}

TEST_P(MatchingKernels, NormsAtTheLimitOfTheKeys) {
  // 63 or 64 in every component: squared norms from 508,032 to 524,288, on both sides of the limit; opposite halves
  // give the largest distances that keys must hold.
  Descriptor left{}, right{};
  for (std::size_t k = 0; k < 64; ++k) left[k] = right[k + 64] = 90;  // 518,400 each, 1,036,800 apart
  Descriptors a(7, left), b(1030, right);
  b[1029][0] = 1;
  a[6][127] = 2;
  ExpectBruteForce(a, b);
  ExpectBruteForce(RandomBytes(40, 11, 62, 63), RandomBytes(80, 12, 62, 63));
  ExpectBruteForce(RandomBytes(40, 13, 63, 64), RandomBytes(80, 14, 63, 64));
}

INSTANTIATE_TEST_SUITE_P(All, MatchingKernels, testing::Values("scalar", "avx2", "avx512"));

TEST(MatchingKernelsTogether, AgreeBeyondOneSweepOfColumns) {
  // 11 index bits name 16384 columns of AVX2 and 32768 of AVX-512.
  Descriptors a = RandomTies(20, 15), b = RandomTies(33'000, 16);
  const Descriptors extra = RandomSift(20, 17);
  a.insert(a.end(), extra.begin(), extra.end());
  b.insert(b.begin() + 16'380, extra.begin(), extra.end());
  b.insert(b.end(), extra.begin(), extra.end());
  SerialRunContext context;
  const NeighborTable expected = FindTwoNearest(a, b, ChooseKernel("scalar"), context);
  for (const Kernel& kernel : AllKernels()) {
    if (!kernel.is_supported) continue;
    const NeighborTable table = FindTwoNearest(a, b, kernel, context);
    ExpectEqualTables(table.of_a, expected.of_a, std::string(kernel.name) + " rows");
    ExpectEqualTables(table.of_b, expected.of_b, std::string(kernel.name) + " columns");
  }
}

TEST(MatchingKernelsTogether, TheChoiceFollowsTheNameAndRefusesNonsense) {
  EXPECT_EQ(ChooseKernel("scalar").name, "scalar");
  EXPECT_TRUE(ChooseKernel("").is_supported);
  EXPECT_THROW(ChooseKernel("avx1024"), Error);
  for (const Kernel& kernel : AllKernels()) {
    if (kernel.is_supported) {
      EXPECT_EQ(&ChooseKernel(kernel.name), &kernel);
    } else {
      EXPECT_THROW(ChooseKernel(kernel.name), Error);
    }
  }
}

/// The contract in floating point, from brute-force neighbours. Without a second neighbour the ratio passes.
std::vector<Match> Oracle(const Descriptors& a, const Descriptors& b, const Options& options) {
  const auto of_a = BruteForce(a, b), of_b = BruteForce(b, a);
  const auto passes = [&](const BestTwo& best) {
    return best.second_sq == BestTwo::kNone || std::sqrt(best.first_sq) < options.ratio * std::sqrt(best.second_sq);
  };
  std::vector<Match> matches;
  for (std::uint32_t i = 0; i < a.size(); ++i) {
    const BestTwo& best = of_a[i];
    if (best.first_sq == BestTwo::kNone || !passes(best)) continue;
    if (options.mutual && (of_b[best.index].index != i || !passes(of_b[best.index]))) continue;
    bool is_beaten = false;
    for (std::uint32_t other = 0; other < a.size(); ++other) {
      if (other == i || of_a[other].index != best.index || !passes(of_a[other])) continue;
      is_beaten |= std::tie(of_a[other].first_sq, other) < std::tie(best.first_sq, i);
    }
    if (!is_beaten) matches.push_back({i, best.index});
  }
  return matches;
}

/// A second image that sees part of the first one's features with noise, in another order, some of them twice.
Descriptors SecondImage(const Descriptors& a, std::size_t others, std::uint64_t seed) {
  Rng rng(seed);
  Descriptors b = RandomSift(others, seed + 1);
  for (const Descriptor& descriptor : a) {
    for (std::uint32_t copies = rng.Below(3); copies > 0; --copies) {
      Descriptor noisy = descriptor;
      const double noise = rng.Uniform(1, 25);
      for (auto& v : noisy) v = static_cast<std::uint8_t>(std::clamp(v + noise * rng.Normal(), 0.0, 255.0));
      b.insert(b.begin() + rng.Below(static_cast<std::uint32_t>(b.size() + 1)), noisy);
    }
  }
  return b;
}

TEST(Matching, RatioAndMutualCheckFollowTheContract) {
  SerialRunContext context;
  const Descriptors a = RandomSift(150, 20), b = SecondImage(a, 100, 21);
  for (const bool mutual : {true, false}) {
    for (const double ratio : {0.5, 0.7, 0.8, 0.9, 1.0}) {
      const Options options{.ratio = ratio, .mutual = mutual};
      const auto matches = matching::Run(a, b, options, context);
      EXPECT_EQ(matches, Oracle(a, b, options)) << ratio << mutual;
      EXPECT_FALSE(matches.empty());
      std::set<std::uint32_t> seconds;
      for (const Match& m : matches) seconds.insert(m.second);
      EXPECT_EQ(seconds.size(), matches.size());
      EXPECT_TRUE(std::is_sorted(matches.begin(), matches.end()));
    }
  }
}

TEST(Matching, MutualMatchesAreTheSameFromEitherSide) {
  SerialRunContext context;
  const Descriptors a = RandomSift(200, 22), b = SecondImage(a, 50, 23);
  const auto forward = matching::Run(a, b, {}, context);
  auto backward = matching::Run(b, a, {}, context);
  for (Match& m : backward) std::swap(m.first, m.second);
  std::sort(backward.begin(), backward.end());
  EXPECT_EQ(forward, backward);
  EXPECT_GT(forward.size(), 20U);
}

TEST(Matching, TheRatioIsStrictAndExact) {
  // Distances 4 and 5: passes above 0.8 only.
  Descriptor origin{}, four{}, five{};
  four[0] = 4;
  five[1] = 5;
  SerialRunContext context;
  const Descriptors a{origin}, b{five, four};
  EXPECT_TRUE(matching::Run(a, b, {.ratio = 0.8, .mutual = false}, context).empty());
  EXPECT_EQ(matching::Run(a, b, {.ratio = 0.8001, .mutual = false}, context), (std::vector<Match>{{0, 1}}));
}

TEST(Matching, EmptyAndSingleDescriptors) {
  SerialRunContext context;
  const Descriptors none, one = RandomSift(1, 24), two = RandomSift(2, 25);
  EXPECT_TRUE(matching::Run(none, none, {}, context).empty());
  EXPECT_TRUE(matching::Run(none, two, {}, context).empty());
  EXPECT_TRUE(matching::Run(two, none, {}, context).empty());
  EXPECT_EQ(matching::Run(one, one, {}, context).size(), 1U);
  EXPECT_TRUE(matching::Run(one, Descriptors{one[0], one[0]}, {}, context).empty());  // ambiguous
}

TEST(Matching, AStopRequestEndsIt) {
  class Stopped : public SerialRunContext {
    bool StopRequested() const override { return true; }
  } context;
  const Descriptors a = RandomSift(10, 26);
  EXPECT_THROW(matching::Run(a, a, {}, context), Cancelled);
}

}  // namespace
}  // namespace rilievo::matching
