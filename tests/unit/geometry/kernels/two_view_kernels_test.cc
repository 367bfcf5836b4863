// Residuals, scores and sums of the kernels against plain double arithmetic, and every level against the scalar one.
#include "geometry/kernels/two_view_kernels.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cstring>

#include "base/error.h"
#include "base/rng.h"
#include "geometry/epipolar.h"
#include "geometry/pair_arrays.h"
#include "tests/support/two_view_scenes.h"

namespace rilievo {
namespace {

constexpr CoordinateVariances kVariances{.first = 1.3e-7, .second = 2.1e-7};

TwoViewScene Scene(std::uint64_t seed, std::size_t points) {
  Rng rng(seed);
  return MakeTwoViewScene(rng, {.points = points, .outlier_share = 0.3, .noise = 3e-4});
}

struct Block {
  std::array<std::array<float, kPairBlock>, 4> columns{};
  explicit Block(const TwoViewScene& scene) {
    for (std::size_t i = 0; i < kPairBlock; ++i) {
      columns[0][i] = static_cast<float>(scene.first[i].x());
      columns[1][i] = static_cast<float>(scene.first[i].y());
      columns[2][i] = static_cast<float>(scene.second[i].x());
      columns[3][i] = static_cast<float>(scene.second[i].y());
    }
  }
  PairBlock View() const { return {columns[0].data(), columns[1].data(), columns[2].data(), columns[3].data()}; }
};

std::array<float, 9> Floats(const Eigen::Matrix3d& m) {
  std::array<float, 9> values;
  for (int k = 0; k < 9; ++k) values[static_cast<std::size_t>(k)] = static_cast<float>(m(k / 3, k % 3));
  return values;
}
std::array<double, 9> Doubles(const Eigen::Matrix3d& m) {
  std::array<double, 9> values;
  for (int k = 0; k < 9; ++k) values[static_cast<std::size_t>(k)] = m(k / 3, k % 3);
  return values;
}

Eigen::Matrix3d SomeHomography(Rng& rng) {
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  for (int k = 0; k < 9; ++k) h(k / 3, k % 3) += 0.1 * rng.Normal();
  return h;
}

TEST(TwoViewKernels, ResidualsAreThoseOfTheDefinition) {
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    Rng rng(seed);
    const TwoViewScene scene = Scene(seed, kPairBlock);
    const Block block(scene);
    const Eigen::Matrix3d e = scene.Essential(), h = SomeHomography(rng), inverse = h.inverse();
    const auto v1 = static_cast<float>(kVariances.first), v2 = static_cast<float>(kVariances.second);
    std::array<float, kPairBlock> sampson, both, transfer;
    const TwoViewKernels& kernels = ActiveTwoViewKernels();
    kernels.sampson(Floats(e).data(), v1, v2, block.View(), sampson.data());
    kernels.both_distances(Floats(e).data(), v1, v2, block.View(), both.data());
    kernels.transfer(Floats(h).data(), Floats(inverse).data(), v1, v2, block.View(), transfer.data());
    for (std::size_t i = 0; i < kPairBlock; ++i) {
      const auto near = [](float value, double truth) {
        // In pixels; a coordinate's rounding alone is 1e-4.
        EXPECT_NEAR(std::sqrt(value), std::sqrt(truth), 5e-3 + 1e-5 * std::sqrt(truth));
      };
      near(sampson[i], SquaredSampson(e, scene.first[i], scene.second[i], kVariances));
      near(both[i], SquaredEpipolarDistances(e, scene.first[i], scene.second[i], kVariances));
      const double truth = SquaredTransfer(h, inverse, scene.first[i], scene.second[i], kVariances);
      if (std::isfinite(truth))
        near(transfer[i], truth);
      else
        EXPECT_EQ(transfer[i], 1e30F);
    }
  }
}

TEST(TwoViewKernels, TruncationCountsAndSumsOnlyWhatExists) {
  std::array<float, kPairBlock> squared;
  for (std::size_t i = 0; i < kPairBlock; ++i) squared[i] = i % 3 == 0 ? 1.0F : 9.0F;
  squared[4] = std::nanf("");
  for (const int count : {0, 1, 15, 16, 17, 40, 63, 64}) {
    int inliers = 0;
    for (int i = 0; i < count; ++i) inliers += i % 3 == 0;
    const BlockScore score = ActiveTwoViewKernels().truncate(squared.data(), count, 4.0F);
    EXPECT_EQ(score.inliers, inliers);
    EXPECT_FLOAT_EQ(score.cost, static_cast<float>(0.25 * inliers + (count - inliers)));
  }
}

TEST(TwoViewKernels, SampsonSumsAreThoseOfFiniteDifferences) {
  for (const std::size_t n : {8U, 13U, 50U}) {
    const TwoViewScene scene = Scene(n, n);
    const PairArrays pairs(scene.first, scene.second);
    const Eigen::Matrix3d e = scene.Essential();
    MatrixSums sums;
    ActiveTwoViewKernels().sampson_sums(Doubles(e).data(), kVariances.first, kVariances.second, pairs.Columns(), sums);
    const auto signed_root = [&](const Eigen::Matrix3d& m, std::size_t i) {
      const double r = std::sqrt(SquaredSampson(m, scene.first[i], scene.second[i], kVariances));
      return scene.second[i].homogeneous().dot(m * scene.first[i].homogeneous()) < 0 ? -r : r;
    };
    double squares = 0;
    Eigen::Matrix<double, 9, 1> right = Eigen::Matrix<double, 9, 1>::Zero();
    Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
    for (std::size_t i = 0; i < n; ++i) {
      Eigen::Matrix<double, 9, 1> g;
      for (int k = 0; k < 9; ++k) {
        Eigen::Matrix3d step = Eigen::Matrix3d::Zero();
        step(k / 3, k % 3) = 1e-6;
        g[k] = (signed_root(e + step, i) - signed_root(e - step, i)) / 2e-6;
      }
      const double r = signed_root(e, i);
      squares += r * r;
      right += r * g;
      normal += g * g.transpose();
    }
    EXPECT_NEAR(sums.squares / squares, 1, 1e-10);
    int next = 0;
    for (int i = 0; i < 9; ++i) {
      EXPECT_NEAR(sums.right[i], right[i], 1e-5 * right.norm());
      for (int j = i; j < 9; ++j) EXPECT_NEAR(sums.normal[next++], normal(i, j), 1e-5 * normal.norm());
    }
  }
}

/// All that the kernels give for random input, as bytes.
std::vector<float> BlockOutput(const TwoViewKernels& kernels, std::uint64_t seed) {
  Rng rng(seed);
  const Block block(Scene(seed, kPairBlock));
  const Eigen::Matrix3d h = SomeHomography(rng);
  const auto m = Floats(h), n = Floats(h.inverse());
  const auto v1 = static_cast<float>(kVariances.first), v2 = static_cast<float>(kVariances.second);
  std::vector<float> out(3 * kPairBlock);
  kernels.sampson(m.data(), v1, v2, block.View(), out.data());
  kernels.both_distances(m.data(), v1, v2, block.View(), out.data() + kPairBlock);
  kernels.transfer(m.data(), n.data(), v1, v2, block.View(), out.data() + 2 * kPairBlock);
  for (const int count : {5, 33, 64}) {
    const BlockScore score = kernels.truncate(out.data(), count, out[0]);
    out.push_back(score.cost);
    out.push_back(static_cast<float>(score.inliers));
  }
  return out;
}

TEST(TwoViewKernels, EveryLevelGivesTheSameBytes) {
  for (const TwoViewKernels& kernels : AllTwoViewKernels().subspan(1)) {
    if (!kernels.is_supported) continue;
    for (std::uint64_t seed = 0; seed < 100; ++seed) {
      const auto expected = BlockOutput(kTwoViewScalar, seed), found = BlockOutput(kernels, seed);
      ASSERT_EQ(std::memcmp(expected.data(), found.data(), expected.size() * sizeof(float)), 0) << kernels.name << seed;
      const TwoViewScene scene = Scene(seed, 1 + seed);
      const PairArrays pairs(scene.first, scene.second);
      MatrixSums sums, expected_sums;
      TransferSums transfer, expected_transfer;
      Rng rng(seed);
      const auto m = Doubles(SomeHomography(rng));
      kTwoViewScalar.sampson_sums(m.data(), 1e-7, 2e-7, pairs.Columns(), expected_sums);
      kernels.sampson_sums(m.data(), 1e-7, 2e-7, pairs.Columns(), sums);
      kTwoViewScalar.transfer_sums(m.data(), pairs.Columns(), expected_transfer);
      kernels.transfer_sums(m.data(), pairs.Columns(), transfer);
      ASSERT_EQ(std::memcmp(&sums, &expected_sums, sizeof sums), 0) << kernels.name << seed;
      ASSERT_EQ(std::memcmp(&transfer, &expected_transfer, sizeof transfer), 0) << kernels.name << seed;
    }
  }
}

TEST(TwoViewKernels, AnUnknownNameIsRefused) {
  EXPECT_THROW(ChooseTwoViewKernels("sse"), Error);
  EXPECT_EQ(ChooseTwoViewKernels("scalar").name, "scalar");
}

}  // namespace
}  // namespace rilievo
