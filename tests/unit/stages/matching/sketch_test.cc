// Sketches bound the distances of descriptors, and matches from them are those of the whole tables.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "base/rng.h"
#include "stages/matching/sketch.h"
#include "stages/matching/sketch_matching.h"
#include "tests/support/descriptors.h"

namespace rilievo::matching {
namespace {

using test::Descriptors;

double Norm(const Sketch& x, const Sketch& y) {
  double sum = 0;
  for (std::size_t k = 0; k < kSketchBytes; ++k) sum += (x[k] - y[k]) * (x[k] - y[k]);
  return std::sqrt(sum);
}

/// The largest share that a sketch keeps of a distance.
double ExpectBounds(const Descriptors& a, const Descriptors& b) {
  double share = 0;
  for (const Descriptor& x : a) {
    double error_x = 0, error_y = 0;
    const Sketch sketch_x = SketchOf(x, error_x);
    for (const Descriptor& y : b) {
      const Sketch sketch_y = SketchOf(y, error_y);
      const double distance = std::sqrt(test::DistanceSq(x, y)), of_sketches = Norm(sketch_x, sketch_y);
      EXPECT_GE(distance + 1e-9, of_sketches - error_x - error_y);
      if (distance > 100) share = std::max(share, of_sketches / distance);
    }
  }
  return share;
}

TEST(Sketch, DistancesAreLowerBounds) {
  ExpectBounds(test::SiftLike(40, 1), test::SiftLike(60, 2));
  EXPECT_GT(ExpectBounds(test::SmoothSift(40, 3), test::SmoothSift(60, 4)), 0.95);  // and no loose ones
  ExpectBounds(test::AnyBytes(40, 5, 0, 80), test::AnyBytes(40, 6, 0, 80));
  const Descriptors same = test::SmoothSift(30, 7);
  ExpectBounds(same, test::SecondView(same, 3, 8));
  // All of it in one component: what single precision gets wrong most.
  Descriptors spikes(128, Descriptor{});
  for (std::size_t k = 0; k < 128; ++k) spikes[k][k] = 255;
  ExpectBounds(spikes, spikes);
  ExpectBounds(Descriptors(2, Descriptor{}), spikes);
}

TEST(Sketch, PaysForSmoothDescriptorsOnly) {
  EXPECT_TRUE(SketchesPay(test::SmoothSift(500, 9)));
  EXPECT_FALSE(SketchesPay(test::SiftLike(500, 10)));
  EXPECT_FALSE(SketchesPay(test::AnyBytes(500, 11)));
  EXPECT_FALSE(SketchesPay({}));
  EXPECT_FALSE(SketchesPay(Descriptors(100, Descriptor{})));  // no variance at all
}

std::vector<PassingNeighbor> FromTables(const NeighborTable& table, const RatioTest& test, bool mutual) {
  std::vector<PassingNeighbor> passing;
  for (std::uint32_t i = 0; i < table.of_a.size(); ++i) {
    const BestTwo& best = table.of_a[i];
    if (!test.Passes(best)) continue;
    const BestTwo& back = table.of_b[best.index];
    if (!mutual || (back.index == i && test.Passes(back))) passing.push_back({i, best.index, best.first_sq});
  }
  return passing;
}

class SketchMatching : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    for (const Kernel& kernel : AllKernels())
      if (kernel.name == GetParam()) kernel_ = &kernel;
    ASSERT_NE(kernel_, nullptr);
    if (!kernel_->is_supported) GTEST_SKIP() << "this processor has no " << GetParam();
  }
  /// Returns what was compared in full with a ratio of 0.8 and a mutual check.
  SketchCounts ExpectTheSame(const Descriptors& a, const Descriptors& b, std::size_t least_matches) {
    const SerialRunContext context;
    const Prepared pa = Prepare(a, *kernel_, SketchUse::kWherePossible);
    const Prepared pb = Prepare(b, *kernel_, SketchUse::kWherePossible);
    EXPECT_TRUE(CanMatchBySketches(pa, pb));
    const NeighborTable table = FindTwoNearest(pa, pb, context);
    SketchCounts usual;
    for (const std::int64_t ratio_e4 : {5000, 8000, 9500, 10000}) {
      for (const bool mutual : {true, false}) {
        const RatioTest test{ratio_e4};
        SketchCounts counts;
        const auto found = MatchBySketches(pa, pb, test, mutual, context, &counts);
        const auto expected = FromTables(table, test, mutual);
        EXPECT_EQ(found.size(), expected.size()) << ratio_e4 << mutual;
        for (std::size_t i = 0; i < std::min(found.size(), expected.size()); ++i) {
          EXPECT_EQ(found[i].first, expected[i].first) << ratio_e4 << mutual;
          EXPECT_EQ(found[i].second, expected[i].second) << ratio_e4 << mutual;
          EXPECT_EQ(found[i].distance_sq, expected[i].distance_sq) << ratio_e4 << mutual;
        }
        if (ratio_e4 == 8000 && mutual) {
          EXPECT_GE(found.size(), least_matches);
          usual = counts;
        }
      }
    }
    return usual;
  }
  const Kernel* kernel_ = nullptr;
};

TEST_P(SketchMatching, OverlappingImages) {
  const Descriptors a = test::SmoothSift(2500, 20);
  const Descriptors b = test::SecondView(a, 6, 21, test::SmoothSift(1300, 22));
  const SketchCounts counts = ExpectTheSame(a, b, 900);
  EXPECT_LT(counts.full_rows, a.size() / 4);  // the sketches do most of the work
  EXPECT_LT(counts.full_columns, b.size() / 4);
}

TEST_P(SketchMatching, UnrelatedImages) {
  const Descriptors a = test::SmoothSift(700, 23), b = test::SmoothSift(2100, 24);
  EXPECT_LT(ExpectTheSame(a, b, 0).full_rows, a.size() / 2);
}

TEST_P(SketchMatching, RepeatedAndEqualDescriptors) {
  Descriptors a = test::SmoothSift(300, 25);
  Descriptors b = test::SecondView(a, 4, 26, test::SmoothSift(200, 27));
  b.insert(b.end(), b.begin(), b.begin() + 120);  // every match of these is ambiguous in b
  a.insert(a.end(), a.begin(), a.begin() + 60);
  ExpectTheSame(a, b, 20);
  ExpectTheSame(test::Ties(400, 28), test::Ties(300, 29), 0);
}

TEST_P(SketchMatching, DescriptorsThatSketchesTellLittleAbout) {
  const Descriptors a = test::SiftLike(600, 30);
  ExpectTheSame(a, test::SecondView(a, 10, 31), 200);
}

TEST_P(SketchMatching, MoreColumnsThanOneSweep) {
  const Descriptors a = test::SmoothSift(300, 32);
  Descriptors b = test::SmoothSift(33'000, 33);
  for (std::size_t i = 0; i < a.size(); ++i) b[(i * 997 + 16'380) % b.size()] = a[i];
  b.resize(32'769);  // one column in the last sweep of the widest kernel
  ExpectTheSame(a, b, 100);
  ExpectTheSame(b, a, 100);
}

INSTANTIATE_TEST_SUITE_P(All, SketchMatching, testing::Values("avx2", "avx512"));

TEST(SketchesOfKernels, NoneForTheScalarOneAndForLargeNorms) {
  EXPECT_FALSE(MakeSketches(test::SmoothSift(10, 34), ChooseKernel("scalar")).Exist());
  for (const Kernel& kernel : AllKernels()) {
    if (!kernel.is_supported) continue;
    const Descriptors large(300, [] {
      Descriptor all;
      all.fill(255);
      return all;
    }());
    EXPECT_FALSE(Prepare(large, kernel, SketchUse::kWherePossible).sketches.Exist());
  }
}

}  // namespace
}  // namespace rilievo::matching
