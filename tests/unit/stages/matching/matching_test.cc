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
#include "tests/support/descriptors.h"

namespace rilievo::matching {
namespace {

using test::Descriptors;

constexpr auto RandomSift = test::SiftLike;
constexpr auto RandomTies = test::Ties;
constexpr auto RandomBytes = test::AnyBytes;

/// Signed unit vectors times `norm` around 128, as SURF's (norm 256).
Descriptors RandomSurf(std::size_t count, std::uint64_t seed, double norm = 256, std::size_t elements = 128) {
  Rng rng(seed);
  Descriptors result(count);
  for (auto& descriptor : result) {
    descriptor.fill(128);
    std::array<double, 128> values{};
    double norm_sq = 0;
    for (std::size_t k = 0; k < elements; ++k) {
      values[k] = rng.Normal();
      norm_sq += values[k] * values[k];
    }
    for (std::size_t k = 0; k < elements; ++k) {
      const double value = 128 + norm * values[k] / std::sqrt(norm_sq);
      descriptor[k] = static_cast<std::uint8_t>(std::clamp(std::round(value), 0.0, 255.0));
    }
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

/// A sweep by the letter of SweepBlock, for processors that lack the wide kernels: the arithmetic of keys can be tested
/// everywhere.
template <Encoding kEncoding, std::size_t kLanes, std::size_t kVectors>
void PlainSweep(const SweepBlock& block) {
  constexpr std::size_t kWidth = kLanes * kVectors;
  const auto update = [](std::int32_t* keys, std::int32_t key) {
    keys[kLanes] = std::min(keys[kLanes], std::max(keys[0], key));
    keys[0] = std::min(keys[0], key);
  };
  for (std::size_t panel = 0; panel < block.panel_count; ++panel) {
    for (std::size_t row = 0; row < block.row_count; ++row) {
      for (std::size_t column = 0; column < kWidth; ++column) {
        std::int32_t dot = 0;
        for (std::size_t k = 0; k < block.words; ++k) {
          const std::uint32_t a = block.rows[row * block.words + k],
                              b = block.panels[(panel * block.words + k) * kWidth + column];
          for (unsigned shift = 0; shift < 32; shift += kEncoding == Encoding::kBytes ? 8 : 16) {
            dot += kEncoding == Encoding::kBytes
                       ? static_cast<std::int8_t>(a >> shift) * static_cast<std::uint8_t>(b >> shift)
                       : static_cast<std::int16_t>(a >> shift) * static_cast<std::int16_t>(b >> shift);
          }
        }
        const auto base = static_cast<std::uint32_t>(block.column_bases[panel * kWidth + column]);
        const std::uint32_t key = base - (static_cast<std::uint32_t>(dot) << 12);
        const std::size_t lane = column % kLanes;
        update(block.row_keys + row * 2 * kLanes + lane, static_cast<std::int32_t>(key));
        update(block.column_keys + (panel * kVectors + column / kLanes) * 2 * kLanes + lane,
               static_cast<std::int32_t>(key + static_cast<std::uint32_t>(block.row_constants[row])));
      }
    }
  }
}

const std::array<Kernel, 2>& PlainKernels() {
  static const std::array<Kernel, 2> kernels = {Kernel{.name = "plain_bytes",
                                                       .encoding = Encoding::kBytes,
                                                       .lanes = 16,
                                                       .vectors = 4,
                                                       .sweep = PlainSweep<Encoding::kBytes, 16, 4>},
                                                Kernel{.name = "plain_shorts",
                                                       .encoding = Encoding::kSignedShorts,
                                                       .lanes = 8,
                                                       .vectors = 2,
                                                       .sweep = PlainSweep<Encoding::kSignedShorts, 8, 2>}};
  return kernels;
}

class MatchingKernels : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    for (const Kernel& kernel : PlainKernels()) {
      if (kernel.name == GetParam()) kernel_ = &kernel;
    }
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

TEST_P(MatchingKernels, SignedDescriptors) {
  for (const std::size_t elements : {64, 128}) {
    for (const std::size_t na : {1, 5, 6, 61}) {
      for (const std::size_t nb : {1, 16, 65, 130})
        ExpectBruteForce(RandomSurf(na, na, 256, elements), RandomSurf(nb, 100 + nb, 256, elements));
    }
  }
  ExpectBruteForce(RandomSurf(1500, 30), RandomSurf(333, 31));
  ExpectBruteForce(RandomSurf(40, 32), RandomSift(77, 33));  // one from 128, the other one from 0
}

TEST_P(MatchingKernels, SignedNormsAtTheLimitOfTheKeys) {
  // The largest sums, both signs, against the same and the opposite vector: d^2 from 0 to 4 N, sum(a) to sqrt(128 N).
  // 24 and 25 from 128 in every component are 73,728 and 80,000, on both sides of the limit of 78,400.
  // 45 and 46: 259,200 and 270,848, on both sides of the limit of 260,000 of shorts.
  for (const int size : {24, 25, 45, 46, 63}) {
    Descriptor low, high, mixed;
    low.fill(static_cast<std::uint8_t>(128 - size));
    high.fill(static_cast<std::uint8_t>(128 + size));
    for (std::size_t k = 0; k < 128; ++k) mixed[k] = static_cast<std::uint8_t>(k % 2 == 0 ? 128 - size : 128 + size);
    Descriptors a(9, low), b(1100, high);
    a[2] = high, a[5] = mixed;
    b[3] = mixed, b[1099] = low;
    ++a[7][17], --b[512][3];
    ExpectBruteForce(a, b);
    ExpectBruteForce(b, a);
  }
  ExpectBruteForce(RandomSurf(60, 34, 278), RandomSurf(90, 35, 278));
  ExpectBruteForce(RandomSurf(60, 36, 283), RandomSurf(90, 37, 283));
}

INSTANTIATE_TEST_SUITE_P(All, MatchingKernels,
                         testing::Values("scalar", "avx2", "avx512", "plain_bytes", "plain_shorts"));

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

ImageFeatures WithSigns(const Descriptors& descriptors, std::uint64_t seed, std::uint32_t signs) {
  Rng rng(seed);
  ImageFeatures features;
  features.descriptors = descriptors;
  features.keypoints.resize(descriptors.size());
  for (Keypoint& k : features.keypoints)
    k.sign = static_cast<std::int32_t>(rng.Below(signs)) * (signs == 2 ? 2 : 1) - 1;
  return features;
}

TEST(Matching, BySignIsASearchAmongFeaturesOfEqualSign) {
  SerialRunContext context;
  const Descriptors a = RandomSift(120, 40), b = SecondImage(a, 60, 41);
  for (const std::uint32_t signs : {2U, 3U}) {
    const ImageFeatures fa = WithSigns(a, 42, signs), fb = WithSigns(b, 43, signs);
    for (const bool mutual : {true, false}) {
      const Options options{.ratio = 0.9, .mutual = mutual};
      std::vector<Match> expected;
      for (const std::int32_t sign : {-1, 0, 1}) {
        std::vector<std::uint32_t> ia, ib;
        Descriptors part_a, part_b;
        for (std::uint32_t i = 0; i < a.size(); ++i) {
          if (fa.keypoints[i].sign == sign) ia.push_back(i), part_a.push_back(a[i]);
        }
        for (std::uint32_t i = 0; i < b.size(); ++i) {
          if (fb.keypoints[i].sign == sign) ib.push_back(i), part_b.push_back(b[i]);
        }
        for (const Match& m : Oracle(part_a, part_b, options)) expected.push_back({ia[m.first], ib[m.second]});
      }
      std::sort(expected.begin(), expected.end());
      const auto found = matching::RunBySign(fa, fb, options, context);
      EXPECT_EQ(found, expected);
      EXPECT_GT(found.size(), 5U);
      for (const Match& m : found) EXPECT_EQ(fa.keypoints[m.first].sign, fb.keypoints[m.second].sign);
    }
  }
  const ImageFeatures same_a = WithSigns(a, 44, 1), same_b = WithSigns(b, 45, 1), none;
  EXPECT_EQ(matching::RunBySign(same_a, same_b, {}, context), matching::Run(a, b, {}, context));
  EXPECT_TRUE(matching::RunBySign(same_a, none, {}, context).empty());
  EXPECT_TRUE(matching::RunBySign(none, same_b, {}, context).empty());
}

TEST(Matching, AStopRequestEndsIt) {
  class Stopped : public SerialRunContext {
    bool StopRequested() const override { return true; }
  } context;
  const Descriptors a = RandomSift(10, 26);
  EXPECT_THROW(matching::Run(a, a, {}, context), Cancelled);
}

TEST(MatcherChoice, AutoGoesByTheNumberOfComparisonsAlone) {
  EXPECT_EQ(MatcherFor(16'384, 16'384, {}), Matcher::kM2);
  EXPECT_EQ(MatcherFor(65'536, 65'536, {}), Matcher::kM2);
  EXPECT_EQ(MatcherFor(65'536, 65'537, {}), Matcher::kCells);
  EXPECT_EQ(MatcherFor(1'048'576, 4096, {}), Matcher::kM2);
  for (const std::size_t count : {0, 100, 1'000'000}) {
    EXPECT_EQ(MatcherFor(count, count, {.matcher = "m2"}), Matcher::kM2);
    EXPECT_EQ(MatcherFor(count, count, {.matcher = "cells"}), Matcher::kCells);
    EXPECT_EQ(MatcherFor(count, count, {.matcher = "kd-tree"}), Matcher::kKdTree);
  }
}

TEST(MatcherChoice, OptionsAreCheckedAndCount) {
  const Options plain;
  EXPECT_NO_THROW(ValidateOptions(plain, OptionDeclarations()));
  EXPECT_NO_THROW(ValidateOptions(Options{.matcher = "kd-tree", .kd_checks = 0}, OptionDeclarations()));
  EXPECT_THROW(ValidateOptions(Options{.matcher = "flann"}, OptionDeclarations()), Error);
  EXPECT_THROW(ValidateOptions(Options{.kd_checks = -1}, OptionDeclarations()), Error);
  EXPECT_THROW(ValidateOptions(Options{.visited_cells = 0}, OptionDeclarations()), Error);
  const std::string key = OptionKeyText(plain, OptionDeclarations());
  for (const Options& other : {Options{.matcher = "cells"}, Options{.kd_checks = 0}, Options{.visited_cells = 4}})
    EXPECT_NE(OptionKeyText(other, OptionDeclarations()), key);
}

TEST(MatcherChoice, TheEstimateOfACapCoversFewerFeatures) {
  for (const char* matcher : {"auto", "m2", "cells", "kd-tree"}) {
    const Options options{.matcher = matcher};
    for (const std::size_t cap : {1000, 70'000, 1'000'000}) {
      const std::uint64_t of_cap = Estimate(cap, cap, options).peak_bytes;
      for (std::size_t fewer = cap; fewer > 0; fewer /= 3) {
        EXPECT_GE(of_cap, Estimate(fewer, cap, options).peak_bytes) << matcher << fewer;
        EXPECT_GE(of_cap, Estimate(cap, fewer, options).peak_bytes) << matcher << fewer;
      }
    }
  }
}

TEST(MatcherChoice, AStopRequestEndsEveryMatcher) {
  class Stopped : public SerialRunContext {
    bool StopRequested() const override { return true; }
  } context;
  const Descriptors a = RandomSift(2000, 50);
  for (const char* matcher : {"m2", "cells", "kd-tree"})
    EXPECT_THROW(matching::Run(a, a, {.matcher = matcher, .visited_cells = 1}, context), Cancelled) << matcher;
}

}  // namespace
}  // namespace rilievo::matching
