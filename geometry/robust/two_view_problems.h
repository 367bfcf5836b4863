// Essential matrix, fundamental matrix and homography as problems of the robust loop.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "geometry/epipolar.h"
#include "geometry/kernels/two_view_kernels.h"
#include "geometry/pair_arrays.h"
#include "geometry/robust/estimate.h"
#include "geometry/solvers/model_list.h"
#include "geometry/solvers/seven_point.h"

namespace rilievo {

/// Pairs of points in ideal coordinates (x, y) = (X/Z, Y/Z), in random order. The single-precision copy, a coordinate
/// an array padded to whole blocks, is what scoring reads.
class PointPairs {
 public:
  PointPairs(std::vector<Eigen::Vector2d> first, std::vector<Eigen::Vector2d> second,
             const CoordinateVariances& variances);

  std::size_t Size() const { return first_.size(); }
  const std::vector<Eigen::Vector2d>& First() const { return first_; }
  const std::vector<Eigen::Vector2d>& Second() const { return second_; }
  const CoordinateVariances& Variances() const { return variances_; }
  PairBlock BlockAt(std::size_t begin) const { return RepairedBlockAt(begin, 0); }
  /// The first points of items begin, begin + 1, ... with the second points of the items `shift` further on (shift <=
  /// kRobustBlock; past Size() values mean nothing).
  PairBlock RepairedBlockAt(std::size_t begin, std::size_t shift) const;
  /// The pairs of these items, in their order: as pairs, and as what refinements read.
  PointPairs Subset(std::span<const std::uint32_t> items) const;
  PairArrays Arrays(std::span<const std::uint32_t> items) const;

 private:
  std::vector<Eigen::Vector2d> first_, second_;
  std::vector<float> coordinates_;
  std::size_t stride_ = 0;
  CoordinateVariances variances_;
};

/// Residual of E and F: Sampson's, or (LMedS as the Record paper has it) both distances to the epipolar lines.
enum class EpipolarResidual { kSampson, kBothDistances };

/// The models of several five-point samples.
class EssentialBatch {
 public:
  int size() const { return models.size; }
  Eigen::Matrix3d operator[](int i) const {
    return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(models.matrices[i]);
  }
  FivePointModels models;
};

/// Five-point samples, eight at a time; of their solutions only those that have all five points on one side of both
/// cameras. Refined by Levenberg-Marquardt on the Sampson distances.
class EssentialProblem {
 public:
  using Model = Eigen::Matrix3d;
  static constexpr int kSampleSize = 5, kBatch = kFivePointBatch;
  EssentialProblem(const PointPairs& pairs, EpipolarResidual residual,
                   const TwoViewKernels& kernels = ActiveTwoViewKernels())
      : pairs_(pairs), residual_(residual), kernels_(kernels) {}
  std::size_t Size() const { return pairs_.Size(); }
  EssentialBatch SolveBatch(const std::array<std::array<std::uint32_t, 5>, kBatch>& samples) const;
  double SquaredResidual(const Model& e, std::size_t i) const;
  std::array<float, kRobustBlock> BlockResiduals(const Model& e, std::size_t begin) const;
  BlockScore Truncate(const std::array<float, kRobustBlock>& squared, int count, float limit) const {
    return kernels_.truncate(squared.data(), count, limit);
  }
  std::optional<Model> Refine(std::span<const std::uint32_t> items, const Model& start) const;

 private:
  const PointPairs& pairs_;
  EpipolarResidual residual_;
  const TwoViewKernels& kernels_;
};

/// How often wrong pairs agree with E or F: the share of the items re-paired with the second points of up to eight
/// others (which sees how the points really lie) whose Sampson distance is within the threshold; 1 for a single item.
double ChanceAgreement(const PointPairs& pairs, const Eigen::Matrix3d& model, double threshold,
                       const TwoViewKernels& kernels = ActiveTwoViewKernels());

/// Seven-point samples, refined by Levenberg-Marquardt on the Sampson distances. Wants coordinates of magnitude about
/// 1, which ideal coordinates of even a guessed focal length are.
class FundamentalProblem {
 public:
  using Model = Eigen::Matrix3d;
  static constexpr int kSampleSize = 7;
  FundamentalProblem(const PointPairs& pairs, EpipolarResidual residual,
                     const TwoViewKernels& kernels = ActiveTwoViewKernels())
      : pairs_(pairs), residual_(residual), kernels_(kernels) {}
  std::size_t Size() const { return pairs_.Size(); }
  FundamentalList Solve(const std::array<std::uint32_t, 7>& sample) const;
  double SquaredResidual(const Model& f, std::size_t i) const;
  std::array<float, kRobustBlock> BlockResiduals(const Model& f, std::size_t begin) const;
  BlockScore Truncate(const std::array<float, kRobustBlock>& squared, int count, float limit) const {
    return kernels_.truncate(squared.data(), count, limit);
  }
  std::optional<Model> Refine(std::span<const std::uint32_t> items, const Model& start) const;

 private:
  const PointPairs& pairs_;
  EpipolarResidual residual_;
  const TwoViewKernels& kernels_;
};

struct Homography {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity(), inverse = Eigen::Matrix3d::Identity();
};

/// Four-point samples, mean squared transfer of both directions, refined by Levenberg-Marquardt on it.
class HomographyProblem {
 public:
  using Model = Homography;
  static constexpr int kSampleSize = 4;
  explicit HomographyProblem(const PointPairs& pairs, const TwoViewKernels& kernels = ActiveTwoViewKernels())
      : pairs_(pairs), kernels_(kernels) {}
  std::size_t Size() const { return pairs_.Size(); }
  ModelList<Homography, 1> Solve(const std::array<std::uint32_t, 4>& sample) const;
  double SquaredResidual(const Model& h, std::size_t i) const;
  std::array<float, kRobustBlock> BlockResiduals(const Model& h, std::size_t begin) const;
  BlockScore Truncate(const std::array<float, kRobustBlock>& squared, int count, float limit) const {
    return kernels_.truncate(squared.data(), count, limit);
  }
  std::optional<Model> Refine(std::span<const std::uint32_t> items, const Model& start) const;

 private:
  const PointPairs& pairs_;
  const TwoViewKernels& kernels_;
};

/// Two-point samples of a pure rotation (as the homography it is), refined by the best rotation of the rays (Kabsch
/// 1976).
class RotationProblem {
 public:
  using Model = Homography;
  static constexpr int kSampleSize = 2;
  explicit RotationProblem(const PointPairs& pairs, const TwoViewKernels& kernels = ActiveTwoViewKernels())
      : pairs_(pairs), transfer_(pairs, kernels) {}
  std::size_t Size() const { return pairs_.Size(); }
  ModelList<Homography, 1> Solve(const std::array<std::uint32_t, 2>& sample) const;
  double SquaredResidual(const Model& r, std::size_t i) const { return transfer_.SquaredResidual(r, i); }
  std::array<float, kRobustBlock> BlockResiduals(const Model& r, std::size_t begin) const {
    return transfer_.BlockResiduals(r, begin);
  }
  BlockScore Truncate(const std::array<float, kRobustBlock>& squared, int count, float limit) const {
    return transfer_.Truncate(squared, count, limit);
  }
  std::optional<Model> Refine(std::span<const std::uint32_t> items, const Model& start) const;

 private:
  const PointPairs& pairs_;
  HomographyProblem transfer_;
};

}  // namespace rilievo
