// Scoring, solving and refining of E, F and H over many pairs of points.
#include "geometry/robust/two_view_problems.h"

#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <utility>

#include "geometry/essential_refinement.h"
#include "geometry/fundamental_refinement.h"
#include "geometry/homography_refinement.h"
#include "geometry/solvers/homography.h"

namespace rilievo {
namespace {

template <int kSize>
std::array<Eigen::Vector3d, kSize> Homogeneous(const std::vector<Eigen::Vector2d>& points,
                                               const std::array<std::uint32_t, kSize>& sample) {
  std::array<Eigen::Vector3d, kSize> rays;
  for (std::size_t i = 0; i < kSize; ++i) rays[i] = points[sample[i]].homogeneous();
  return rays;
}

struct Selection {
  std::vector<Eigen::Vector2d> first, second;
};

Selection Select(const PointPairs& pairs, std::span<const std::uint32_t> items) {
  Selection selection;
  selection.first.reserve(items.size());
  selection.second.reserve(items.size());
  for (const auto i : items) {
    selection.first.push_back(pairs.First()[i]);
    selection.second.push_back(pairs.Second()[i]);
  }
  return selection;
}

struct FloatMatrix {
  float values[9];  // row-major
  explicit FloatMatrix(const Eigen::Matrix3d& m) {
    for (int k = 0; k < 9; ++k) values[k] = static_cast<float>(m(k / 3, k % 3));
  }
};

std::array<float, kRobustBlock> EpipolarBlock(const Eigen::Matrix3d& model, const PointPairs& pairs, std::size_t begin,
                                              EpipolarResidual residual, const TwoViewKernels& kernels) {
  const auto kernel = residual == EpipolarResidual::kSampson ? kernels.sampson : kernels.both_distances;
  std::array<float, kRobustBlock> squared;
  kernel(FloatMatrix(model).values, static_cast<float>(pairs.Variances().first),
         static_cast<float>(pairs.Variances().second), pairs.BlockAt(begin), squared.data());
  return squared;
}

double SquaredEpipolar(const Eigen::Matrix3d& model, const PointPairs& pairs, std::size_t i,
                       EpipolarResidual residual) {
  return residual == EpipolarResidual::kSampson
             ? SquaredSampson(model, pairs.First()[i], pairs.Second()[i], pairs.Variances())
             : SquaredEpipolarDistances(model, pairs.First()[i], pairs.Second()[i], pairs.Variances());
}

/// Few iterations: the loop calls again while its own cost falls.
RefinementOptions LocalRefinement(const TwoViewKernels& kernels) {
  return {.max_iterations = 4, .relative_decrease = 1e-3, .kernels = &kernels};
}

}  // namespace

PointPairs::PointPairs(std::vector<Eigen::Vector2d> first, std::vector<Eigen::Vector2d> second,
                       const CoordinateVariances& variances)
    : first_(std::move(first)), second_(std::move(second)), variances_(variances) {
  stride_ = (first_.size() + kRobustBlock - 1) / kRobustBlock * kRobustBlock + kRobustBlock;
  coordinates_.resize(4 * stride_);
  for (std::size_t i = 0; i < first_.size(); ++i) {
    coordinates_[i] = static_cast<float>(first_[i].x());
    coordinates_[stride_ + i] = static_cast<float>(first_[i].y());
    coordinates_[2 * stride_ + i] = static_cast<float>(second_[i].x());
    coordinates_[3 * stride_ + i] = static_cast<float>(second_[i].y());
  }
}

PairBlock PointPairs::RepairedBlockAt(std::size_t begin, std::size_t shift) const {
  const float* start = coordinates_.data() + begin;
  return {start, start + stride_, start + 2 * stride_ + shift, start + 3 * stride_ + shift};
}

PointPairs PointPairs::Subset(std::span<const std::uint32_t> items) const {
  Selection selection = Select(*this, items);
  return {std::move(selection.first), std::move(selection.second), variances_};
}

PairArrays PointPairs::Arrays(std::span<const std::uint32_t> items) const {
  PairArrays arrays(items.size());
  for (std::size_t i = 0; i < items.size(); ++i) arrays.Set(i, first_[items[i]], second_[items[i]]);
  return arrays;
}

EssentialBatch EssentialProblem::SolveBatch(const std::array<std::array<std::uint32_t, 5>, kBatch>& samples) const {
  FivePointSamples coordinates;
  for (std::size_t lane = 0; lane < samples.size(); ++lane) {
    for (std::size_t i = 0; i < 5; ++i) {
      const Eigen::Vector2d &x = pairs_.First()[samples[lane][i]], &y = pairs_.Second()[samples[lane][i]];
      coordinates.rows[i][lane] = x.x();
      coordinates.rows[5 + i][lane] = x.y();
      coordinates.rows[10 + i][lane] = y.x();
      coordinates.rows[15 + i][lane] = y.y();
    }
  }
  EssentialBatch batch;
  kernels_.five_point_oriented(coordinates, batch.models);
  return batch;
}

double EssentialProblem::SquaredResidual(const Model& e, std::size_t i) const {
  return SquaredEpipolar(e, pairs_, i, residual_);
}

std::array<float, kRobustBlock> EssentialProblem::BlockResiduals(const Model& e, std::size_t begin) const {
  return EpipolarBlock(e, pairs_, begin, residual_, kernels_);
}

std::optional<Eigen::Matrix3d> EssentialProblem::Refine(std::span<const std::uint32_t> items,
                                                        const Model& start) const {
  return RefineEssential(pairs_.Arrays(items), pairs_.Variances(), start, LocalRefinement(kernels_));
}

double ChanceAgreement(const PointPairs& pairs, const Eigen::Matrix3d& model, double threshold,
                       const TwoViewKernels& kernels) {
  constexpr std::size_t kShifts = 8;
  const std::size_t n = pairs.Size();
  const FloatMatrix matrix(model);
  const auto v1 = static_cast<float>(pairs.Variances().first), v2 = static_cast<float>(pairs.Variances().second);
  const auto limit = static_cast<float>(threshold * threshold);
  std::size_t agreeing = 0, tried = 0;
  std::array<float, kRobustBlock> squared;
  for (std::size_t shift = 1; shift <= kShifts && shift < n; ++shift) {
    tried += n - shift;
    for (std::size_t begin = 0; begin < n - shift; begin += kRobustBlock) {
      kernels.sampson(matrix.values, v1, v2, pairs.RepairedBlockAt(begin, shift), squared.data());
      const int count = static_cast<int>(std::min(kRobustBlock, n - shift - begin));
      agreeing += static_cast<std::size_t>(kernels.truncate(squared.data(), count, limit).inliers);
    }
  }
  return tried > 0 ? static_cast<double>(agreeing) / static_cast<double>(tried) : 1;
}

FundamentalList FundamentalProblem::Solve(const std::array<std::uint32_t, 7>& sample) const {
  return SolveSevenPoint(Homogeneous<7>(pairs_.First(), sample), Homogeneous<7>(pairs_.Second(), sample));
}

double FundamentalProblem::SquaredResidual(const Model& f, std::size_t i) const {
  return SquaredEpipolar(f, pairs_, i, residual_);
}

std::array<float, kRobustBlock> FundamentalProblem::BlockResiduals(const Model& f, std::size_t begin) const {
  return EpipolarBlock(f, pairs_, begin, residual_, kernels_);
}

std::optional<Eigen::Matrix3d> FundamentalProblem::Refine(std::span<const std::uint32_t> items,
                                                          const Model& start) const {
  return RefineFundamental(pairs_.Arrays(items), pairs_.Variances(), start, LocalRefinement(kernels_));
}

ModelList<Homography, 1> HomographyProblem::Solve(const std::array<std::uint32_t, 4>& sample) const {
  ModelList<Homography, 1> models;
  const auto h =
      SolveHomographyFourPoint(Homogeneous<4>(pairs_.First(), sample), Homogeneous<4>(pairs_.Second(), sample));
  if (!h) return models;
  const Homography model{*h, h->inverse()};
  if (model.inverse.allFinite()) models.Add(model);
  return models;
}

double HomographyProblem::SquaredResidual(const Model& h, std::size_t i) const {
  return SquaredTransfer(h.matrix, h.inverse, pairs_.First()[i], pairs_.Second()[i], pairs_.Variances());
}

std::array<float, kRobustBlock> HomographyProblem::BlockResiduals(const Model& h, std::size_t begin) const {
  std::array<float, kRobustBlock> squared;
  kernels_.transfer(FloatMatrix(h.matrix).values, FloatMatrix(h.inverse).values,
                    static_cast<float>(pairs_.Variances().first), static_cast<float>(pairs_.Variances().second),
                    pairs_.BlockAt(begin), squared.data());
  return squared;
}

std::optional<Homography> HomographyProblem::Refine(std::span<const std::uint32_t> items, const Model& start) const {
  const auto h = RefineHomography(pairs_.Arrays(items), pairs_.Variances(), start.matrix, LocalRefinement(kernels_));
  if (!h) return std::nullopt;
  const Homography model{*h, h->inverse()};
  if (!model.inverse.allFinite()) return std::nullopt;
  return model;
}

ModelList<Homography, 1> RotationProblem::Solve(const std::array<std::uint32_t, 2>& sample) const {
  ModelList<Homography, 1> models;
  if (const auto rotation = Refine(sample, {})) models.Add(*rotation);
  return models;
}

std::optional<Homography> RotationProblem::Refine(std::span<const std::uint32_t> items, const Model&) const {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (const auto i : items) {
    sum += pairs_.Second()[i].homogeneous().normalized() * pairs_.First()[i].homogeneous().normalized().transpose();
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double sign = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
  const Eigen::Matrix3d rotation = svd.matrixU() * Eigen::Vector3d(1, 1, sign).asDiagonal() * svd.matrixV().transpose();
  if (!rotation.allFinite()) return std::nullopt;
  return Homography{rotation, rotation.transpose()};
}

}  // namespace rilievo
