// The five-point solver against exact synthetic truth and against a dense reference of another kind.
#include "geometry/solvers/five_point.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <complex>
#include <cstring>

#include "base/rng.h"
#include "geometry/epipolar.h"
#include "tests/support/two_view_scenes.h"

namespace rilievo {
namespace {

using Sample = std::array<Eigen::Vector2d, 5>;

double Distance(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) {
  return std::min((a / a.norm() - b / b.norm()).norm(), (a / a.norm() + b / b.norm()).norm());
}

double ConstraintError(const Eigen::Matrix3d& e) {
  const Eigen::Matrix3d eet = e * e.transpose();
  return std::max((2 * eet * e - eet.trace() * e).norm(), std::abs(e.determinant()));
}

std::array<Sample, 2> SampleOf(const TwoViewScene& scene) {
  std::array<Sample, 2> sample;
  for (std::size_t k = 0; k < 5; ++k) sample[0][k] = scene.first[k], sample[1][k] = scene.second[k];
  return sample;
}

struct Statistics {
  double worst_truth = 0, worst_constraint = 0;
  int missed = 0, solutions = 0;
};

Statistics SolveMany(int scenes, bool planar, std::uint64_t seed) {
  Statistics s;
  for (int i = 0; i < scenes; ++i) {
    Rng rng(SeedFor(seed, i));
    const auto scene = MakeTwoViewScene(rng, {.points = 5, .planar = planar});
    const auto [first, second] = SampleOf(scene);
    double nearest = 9;
    for (const auto& e : SolveFivePoint(first, second)) {
      nearest = std::min(nearest, Distance(e, scene.Essential()));
      s.worst_constraint = std::max(s.worst_constraint, ConstraintError(e));
      for (std::size_t k = 0; k < 5; ++k) {
        s.worst_constraint =
            std::max(s.worst_constraint, std::abs(second[k].homogeneous().dot(e * first[k].homogeneous())));
      }
      ++s.solutions;
    }
    s.missed += nearest > 1e-8;
    if (nearest < 1) s.worst_truth = std::max(s.worst_truth, nearest);
  }
  return s;
}

Eigen::Matrix<double, 10, 1> Evaluate(const Eigen::Matrix3d& e) {
  const Eigen::Matrix3d t = e * e.transpose() * e - 0.5 * (e * e.transpose()).trace() * e;
  Eigen::Matrix<double, 10, 1> values;
  values << Eigen::Map<const Eigen::Matrix<double, 9, 1>>(t.data()), e.determinant();
  return values;
}

/// Real solutions with w = 1 by the action matrix of multiplication by x on the quotient ring (Stewénius, Engels &
/// Nistér 2006): ten quadratic-and-lower monomials, eigenvectors of a dense 10 x 10 matrix.
std::vector<Eigen::Matrix3d> ReferenceSolutions(const Sample& first, const Sample& second) {
  Eigen::Matrix<double, 5, 9> a;
  for (int i = 0; i < 5; ++i) {
    const Eigen::Vector3d x = first[static_cast<std::size_t>(i)].homogeneous();
    const Eigen::Vector3d y = second[static_cast<std::size_t>(i)].homogeneous();
    const Eigen::Matrix3d outer = x * y.transpose();
    a.row(i) = Eigen::Map<const Eigen::Matrix<double, 1, 9>>(outer.data());  // row-major E
  }
  const Eigen::JacobiSVD<Eigen::Matrix<double, 5, 9>> svd(a, Eigen::ComputeFullV);
  std::array<Eigen::Matrix3d, 4> basis;
  for (int i = 0; i < 4; ++i) {
    const Eigen::Matrix<double, 9, 1> v = svd.matrixV().col(5 + i);
    basis[static_cast<std::size_t>(i)] = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(v.data());
  }
  // Graded order: ten cubic monomials of x, y, z, then the ten lower ones.
  std::vector<std::array<int, 3>> monomials;
  for (int degree = 3; degree >= 0; --degree) {
    for (int x = degree; x >= 0; --x) {
      for (int y = degree - x; y >= 0; --y) monomials.push_back({x, y, degree - x - y});
    }
  }
  Rng rng(1);
  Eigen::Matrix<double, 40, 20> values;
  Eigen::Matrix<double, 40, 10> results;
  for (int k = 0; k < 40; ++k) {
    const Eigen::Vector3d p(rng.Normal(), rng.Normal(), rng.Normal());
    for (int j = 0; j < 20; ++j) {
      const auto& m = monomials[static_cast<std::size_t>(j)];
      values(k, j) = std::pow(p[0], m[0]) * std::pow(p[1], m[1]) * std::pow(p[2], m[2]);
    }
    results.row(k) = Evaluate(p[0] * basis[0] + p[1] * basis[1] + p[2] * basis[2] + basis[3]).transpose();
  }
  const Eigen::Matrix<double, 10, 20> c = values.colPivHouseholderQr().solve(results).transpose();
  const Eigen::Matrix<double, 10, 10> reduced = c.leftCols<10>().fullPivLu().solve(c.rightCols<10>());
  const auto index = [&](int x, int y, int z) {
    return static_cast<int>(std::find(monomials.begin(), monomials.end(), std::array<int, 3>{x, y, z}) -
                            monomials.begin());
  };
  Eigen::Matrix<double, 10, 10> action = Eigen::Matrix<double, 10, 10>::Zero();
  for (int j = 0; j < 10; ++j) {
    const auto& m = monomials[static_cast<std::size_t>(10 + j)];
    const int product = index(m[0] + 1, m[1], m[2]);
    if (product < 10)
      action.row(j) = -reduced.row(product);
    else
      action(j, product - 10) = 1;
  }
  const Eigen::EigenSolver<Eigen::Matrix<double, 10, 10>> eigen(action);
  std::vector<Eigen::Matrix3d> solutions;
  for (int k = 0; k < 10; ++k) {
    if (std::abs(eigen.eigenvalues()[k].imag()) > 1e-9 * std::abs(eigen.eigenvalues()[k])) continue;
    const Eigen::Matrix<double, 10, 1> v = eigen.eigenvectors().col(k).real();
    const Eigen::Vector3d p =
        Eigen::Vector3d(v[index(1, 0, 0) - 10], v[index(0, 1, 0) - 10], v[index(0, 0, 1) - 10]) / v[9];
    const Eigen::Matrix3d e = p[0] * basis[0] + p[1] * basis[1] + p[2] * basis[2] + basis[3];
    solutions.push_back(e / e.norm());
  }
  return solutions;
}

bool Holds(const auto& list, const Eigen::Matrix3d& e, double tolerance) {
  return std::any_of(list.begin(), list.end(),
                     [&](const Eigen::Matrix3d& other) { return Distance(other, e) < tolerance; });
}

TEST(FivePoint, TruthIsAmongTheSolutionsAndAllObeyTheConstraints) {
  const auto s = SolveMany(20000, false, 1);
  EXPECT_EQ(s.missed, 0) << s.worst_truth;
  EXPECT_LT(s.worst_constraint, 1e-9);
  EXPECT_GT(s.solutions, 20000 * 3);
}

TEST(FivePoint, PlanarScenesAreNoSpecialCase) {
  const auto s = SolveMany(20000, true, 2);
  EXPECT_LE(s.missed, 10);  // five points of a plane can lie so that two solutions meet: ill-conditioned by nature
  EXPECT_LT(s.worst_constraint, 1e-9);
}

TEST(FivePoint, HasTheRealSolutionsOfTheActionMatrixAndNoOthers) {
  int solutions = 0, missed = 0, spurious = 0;
  for (int i = 0; i < 3000; ++i) {
    Rng rng(SeedFor(3, i));
    // Random matches, too: their solutions are as many as those of a scene.
    const auto scene =
        MakeTwoViewScene(rng, {.points = 5, .planar = i % 3 == 1, .outlier_share = i % 3 == 2 ? 1.0 : 0.0});
    const auto [first, second] = SampleOf(scene);
    const auto ours = SolveFivePoint(first, second);
    const auto reference = ReferenceSolutions(first, second);
    solutions += static_cast<int>(reference.size());
    for (const auto& e : reference) missed += !Holds(ours, e, 1e-4);
    for (const auto& e : ours) spurious += !Holds(reference, e, 1e-4);
  }
  EXPECT_GT(solutions, 9000);
  // A double root that rounding splits or closes may be real to the one and complex to the other.
  EXPECT_LE(missed, 6);
  EXPECT_LE(spurious, 6);
}

FivePointSamples ManySamples(std::uint64_t seed) {
  FivePointSamples samples;
  for (int lane = 0; lane < kFivePointBatch; ++lane) {
    Rng rng(SeedFor(seed, lane));
    const auto scene =
        MakeTwoViewScene(rng, {.points = 5, .planar = lane % 2 == 1, .outlier_share = lane > 3 ? 1.0 : 0.0});
    for (std::size_t i = 0; i < 5; ++i) {
      const std::size_t from = seed % 7 == 0 && lane == 2 ? 0 : i;  // now and then a sample without a solution
      samples.rows[i][lane] = scene.first[from].x();
      samples.rows[5 + i][lane] = scene.first[from].y();
      samples.rows[10 + i][lane] = scene.second[from].x();
      samples.rows[15 + i][lane] = scene.second[from].y();
    }
  }
  return samples;
}

TEST(FivePoint, EveryKernelGivesTheSameBytes) {
  int compared = 0;
  for (const TwoViewKernels& kernels : AllTwoViewKernels().subspan(1)) {
    if (!kernels.is_supported) continue;
    for (std::uint64_t seed = 0; seed < 500; ++seed) {
      const FivePointSamples samples = ManySamples(seed);
      for (const auto solver : {&TwoViewKernels::five_point, &TwoViewKernels::five_point_oriented}) {
        FivePointModels reference, models;
        (kTwoViewScalar.*solver)(samples, reference);
        (kernels.*solver)(samples, models);
        ASSERT_EQ(models.size, reference.size) << kernels.name << " " << seed;
        for (int i = 0; i < models.size; ++i) ASSERT_EQ(models.sample[i], reference.sample[i]);
        ASSERT_EQ(std::memcmp(models.matrices, reference.matrices,
                              sizeof models.matrices[0] * static_cast<std::size_t>(models.size)),
                  0)
            << kernels.name << " " << seed;
        compared += models.size;
      }
    }
  }
  if (compared == 0) GTEST_SKIP() << "this processor has the scalar kernels only";
  EXPECT_GT(compared, 1000);
}

TEST(FivePoint, ASampleDoesNotDependOnItsNeighbours) {
  for (std::uint64_t seed = 1; seed < 100; ++seed) {
    FivePointSamples samples = ManySamples(seed), swapped = samples;
    for (int k = 0; k < 20; ++k) std::swap(swapped.rows[k][0], swapped.rows[k][5]);
    FivePointModels a, b;
    ActiveTwoViewKernels().five_point(samples, a);
    ActiveTwoViewKernels().five_point(swapped, b);
    std::vector<std::array<double, 9>> of_a, of_b;
    for (int i = 0; i < a.size; ++i) {
      if (a.sample[i] == 0) of_a.push_back(std::to_array(a.matrices[i]));
    }
    for (int i = 0; i < b.size; ++i) {
      if (b.sample[i] == 5) of_b.push_back(std::to_array(b.matrices[i]));
    }
    EXPECT_EQ(of_a, of_b);
  }
}

/// Oriented solutions are those with all five points in front of both cameras of some pose, or behind both, or on
/// different sides of the two: what a necessary condition leaves. The truth is always among them.
TEST(FivePoint, OrientedSolutionsAreThoseWhosePointsLieOnOneSide) {
  int kept = 0, dropped = 0;
  for (std::uint64_t seed = 1; seed < 300; ++seed) {
    const FivePointSamples samples = ManySamples(seed);
    FivePointModels all, oriented;
    ActiveTwoViewKernels().five_point(samples, all);
    ActiveTwoViewKernels().five_point_oriented(samples, oriented);
    int next = 0;
    for (int i = 0; i < all.size; ++i) {
      const Eigen::Matrix3d e = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(all.matrices[i]);
      const Rigid3 pose = DecomposeEssential(e)[0];
      int same_side = 0;
      for (int k = 0; k < 5; ++k) {  // depths a, b of a u + t = b v
        const Eigen::Vector3d u =
            pose.rotation * Eigen::Vector3d(samples.rows[k][all.sample[i]], samples.rows[5 + k][all.sample[i]], 1);
        const Eigen::Vector3d v(samples.rows[10 + k][all.sample[i]], samples.rows[15 + k][all.sample[i]], 1);
        const Eigen::Vector3d n = u.cross(v), &t = pose.translation;
        same_side += (t.cross(v).dot(n) < 0) == (t.cross(u).dot(n) < 0) ? 1 : 0;
      }
      const bool expected = same_side == 0 || same_side == 5;
      const bool found = next < oriented.size && oriented.sample[next] == all.sample[i] &&
                         std::memcmp(oriented.matrices[next], all.matrices[i], sizeof all.matrices[i]) == 0;
      EXPECT_EQ(found, expected) << seed << " " << i;
      next += found ? 1 : 0;
      (expected ? kept : dropped) += 1;
    }
    EXPECT_EQ(next, oriented.size);
  }
  EXPECT_GT(kept, 1000);
  EXPECT_GT(dropped, 1000);
}

TEST(FivePoint, DegenerateSamplesGiveFiniteMatricesOrNone) {
  Sample first, second;
  for (std::size_t i = 0; i < 5; ++i) first[i] = second[i] = Eigen::Vector2d(0.1, 0.2);
  for (const auto& e : SolveFivePoint(first, second)) EXPECT_TRUE(e.allFinite());
  for (std::size_t i = 0; i < 5; ++i) first[i] = second[i] = Eigen::Vector2d(0.1 * static_cast<double>(i), 0.3);
  for (const auto& e : SolveFivePoint(first, second)) EXPECT_TRUE(e.allFinite());
  for (std::size_t i = 0; i < 5; ++i) first[i] = Eigen::Vector2d(std::nan(""), 0.3);
  EXPECT_EQ(SolveFivePoint(first, second).size(), 0);
}

}  // namespace
}  // namespace rilievo
