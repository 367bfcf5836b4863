// Essential matrix, fundamental matrix and homography as problems of the robust loop.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "geometry/epipolar.h"
#include "geometry/robust/estimate.h"
#include "geometry/solvers/five_point.h"
#include "geometry/solvers/model_list.h"
#include "geometry/solvers/seven_point.h"

namespace rilievo {

/// Pairs of points in ideal coordinates (x, y) = (X/Z, Y/Z), in random order. The single-precision copy, a coordinate
/// an array padded to whole blocks, is what scoring reads.
class PointPairs {
 public:
  PointPairs(std::vector<Eigen::Vector2d> first, std::vector<Eigen::Vector2d> second,
             const CoordinateVariances& variances);

  struct Block {
    const float *x1, *y1, *x2, *y2;  // kRobustBlock values each
  };
  std::size_t Size() const { return first_.size(); }
  const std::vector<Eigen::Vector2d>& First() const { return first_; }
  const std::vector<Eigen::Vector2d>& Second() const { return second_; }
  const CoordinateVariances& Variances() const { return variances_; }
  Block BlockAt(std::size_t begin) const;
  /// The pairs of these items, in their order.
  PointPairs Subset(std::span<const std::uint32_t> items) const;

 private:
  std::vector<Eigen::Vector2d> first_, second_;
  std::vector<float> coordinates_;
  std::size_t stride_ = 0;
  CoordinateVariances variances_;
};

/// Residual of E and F: Sampson's, or (LMedS as the Record paper has it) both distances to the epipolar lines.
enum class EpipolarResidual { kSampson, kBothDistances };

/// Five-point samples, refined by Levenberg-Marquardt on the Sampson distances.
class EssentialProblem {
 public:
  using Model = Eigen::Matrix3d;
  static constexpr int kSampleSize = 5;
  EssentialProblem(const PointPairs& pairs, EpipolarResidual residual) : pairs_(pairs), residual_(residual) {}
  std::size_t Size() const { return pairs_.Size(); }
  EssentialList Solve(const std::array<std::uint32_t, 5>& sample) const;
  double SquaredResidual(const Model& e, std::size_t i) const;
  std::array<float, kRobustBlock> BlockResiduals(const Model& e, std::size_t begin) const;
  std::optional<Model> Refine(std::span<const std::uint32_t> items, const Model& start) const;

 private:
  const PointPairs& pairs_;
  EpipolarResidual residual_;
};

/// Seven-point samples, refined by the eight-point method reweighted to Sampson distances. Wants coordinates of
/// magnitude about 1, which ideal coordinates of even a guessed focal length are.
class FundamentalProblem {
 public:
  using Model = Eigen::Matrix3d;
  static constexpr int kSampleSize = 7;
  FundamentalProblem(const PointPairs& pairs, EpipolarResidual residual) : pairs_(pairs), residual_(residual) {}
  std::size_t Size() const { return pairs_.Size(); }
  FundamentalList Solve(const std::array<std::uint32_t, 7>& sample) const;
  double SquaredResidual(const Model& f, std::size_t i) const;
  std::array<float, kRobustBlock> BlockResiduals(const Model& f, std::size_t begin) const;
  std::optional<Model> Refine(std::span<const std::uint32_t> items, const Model& start) const;

 private:
  const PointPairs& pairs_;
  EpipolarResidual residual_;
};

struct Homography {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity(), inverse = Eigen::Matrix3d::Identity();
};

/// Four-point samples, mean squared transfer of both directions, refined by the linear method.
class HomographyProblem {
 public:
  using Model = Homography;
  static constexpr int kSampleSize = 4;
  explicit HomographyProblem(const PointPairs& pairs) : pairs_(pairs) {}
  std::size_t Size() const { return pairs_.Size(); }
  ModelList<Homography, 1> Solve(const std::array<std::uint32_t, 4>& sample) const;
  double SquaredResidual(const Model& h, std::size_t i) const;
  std::array<float, kRobustBlock> BlockResiduals(const Model& h, std::size_t begin) const;
  std::optional<Model> Refine(std::span<const std::uint32_t> items, const Model& start) const;

 private:
  const PointPairs& pairs_;
};

/// Two-point samples of a pure rotation (as the homography it is), refined by the best rotation of the rays (Kabsch
/// 1976).
class RotationProblem {
 public:
  using Model = Homography;
  static constexpr int kSampleSize = 2;
  explicit RotationProblem(const PointPairs& pairs) : pairs_(pairs), transfer_(pairs) {}
  std::size_t Size() const { return pairs_.Size(); }
  ModelList<Homography, 1> Solve(const std::array<std::uint32_t, 2>& sample) const;
  double SquaredResidual(const Model& r, std::size_t i) const { return transfer_.SquaredResidual(r, i); }
  std::array<float, kRobustBlock> BlockResiduals(const Model& r, std::size_t begin) const {
    return transfer_.BlockResiduals(r, begin);
  }
  std::optional<Model> Refine(std::span<const std::uint32_t> items, const Model& start) const;

 private:
  const PointPairs& pairs_;
  HomographyProblem transfer_;
};

}  // namespace rilievo
