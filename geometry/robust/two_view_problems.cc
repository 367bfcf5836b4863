// Scoring, solving and refining of E, F and H over many pairs of points.
#include "geometry/robust/two_view_problems.h"

#include <Eigen/LU>
#include <Eigen/SVD>
#include <utility>

#include "geometry/essential_refinement.h"
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
  float m00, m01, m02, m10, m11, m12, m20, m21, m22;
  explicit FloatMatrix(const Eigen::Matrix3d& m)
      : m00(static_cast<float>(m(0, 0))),
        m01(static_cast<float>(m(0, 1))),
        m02(static_cast<float>(m(0, 2))),
        m10(static_cast<float>(m(1, 0))),
        m11(static_cast<float>(m(1, 1))),
        m12(static_cast<float>(m(1, 2))),
        m20(static_cast<float>(m(2, 0))),
        m21(static_cast<float>(m(2, 1))),
        m22(static_cast<float>(m(2, 2))) {}
};

/// One straight loop over a block: the compiler makes vector code of it.
template <EpipolarResidual kResidual>
std::array<float, kRobustBlock> EpipolarBlock(const Eigen::Matrix3d& model, const PointPairs::Block& b,
                                              const CoordinateVariances& v) {
  const FloatMatrix m(model);
  const float v1 = static_cast<float>(v.first), v2 = static_cast<float>(v.second);
  std::array<float, kRobustBlock> squared;
  for (std::size_t i = 0; i < kRobustBlock; ++i) {
    const float x1 = b.x1[i], y1 = b.y1[i], x2 = b.x2[i], y2 = b.y2[i];
    const float line_x = m.m00 * x1 + m.m01 * y1 + m.m02;
    const float line_y = m.m10 * x1 + m.m11 * y1 + m.m12;
    const float line_1 = m.m20 * x1 + m.m21 * y1 + m.m22;
    const float back_x = m.m00 * x2 + m.m10 * y2 + m.m20;
    const float back_y = m.m01 * x2 + m.m11 * y2 + m.m21;
    const float error = x2 * line_x + y2 * line_y + line_1;
    const float first = v1 * (back_x * back_x + back_y * back_y);
    const float second = v2 * (line_x * line_x + line_y * line_y);
    if constexpr (kResidual == EpipolarResidual::kSampson) {
      squared[i] = error * error / (first + second);
    } else {
      squared[i] = error * error * (first + second) / (first * second);
    }
  }
  return squared;
}

std::array<float, kRobustBlock> EpipolarBlock(const Eigen::Matrix3d& model, const PointPairs& pairs, std::size_t begin,
                                              EpipolarResidual residual) {
  return residual == EpipolarResidual::kSampson
             ? EpipolarBlock<EpipolarResidual::kSampson>(model, pairs.BlockAt(begin), pairs.Variances())
             : EpipolarBlock<EpipolarResidual::kBothDistances>(model, pairs.BlockAt(begin), pairs.Variances());
}

double SquaredEpipolar(const Eigen::Matrix3d& model, const PointPairs& pairs, std::size_t i,
                       EpipolarResidual residual) {
  return residual == EpipolarResidual::kSampson
             ? SquaredSampson(model, pairs.First()[i], pairs.Second()[i], pairs.Variances())
             : SquaredEpipolarDistances(model, pairs.First()[i], pairs.Second()[i], pairs.Variances());
}

}  // namespace

PointPairs::PointPairs(std::vector<Eigen::Vector2d> first, std::vector<Eigen::Vector2d> second,
                       const CoordinateVariances& variances)
    : first_(std::move(first)), second_(std::move(second)), variances_(variances) {
  stride_ = (first_.size() + kRobustBlock - 1) / kRobustBlock * kRobustBlock;
  coordinates_.resize(4 * stride_);
  for (std::size_t i = 0; i < first_.size(); ++i) {
    coordinates_[i] = static_cast<float>(first_[i].x());
    coordinates_[stride_ + i] = static_cast<float>(first_[i].y());
    coordinates_[2 * stride_ + i] = static_cast<float>(second_[i].x());
    coordinates_[3 * stride_ + i] = static_cast<float>(second_[i].y());
  }
}

PointPairs::Block PointPairs::BlockAt(std::size_t begin) const {
  const float* start = coordinates_.data() + begin;
  return {start, start + stride_, start + 2 * stride_, start + 3 * stride_};
}

PointPairs PointPairs::Subset(std::span<const std::uint32_t> items) const {
  Selection selection = Select(*this, items);
  return {std::move(selection.first), std::move(selection.second), variances_};
}

EssentialList EssentialProblem::Solve(const std::array<std::uint32_t, 5>& sample) const {
  return SolveFivePoint(Homogeneous<5>(pairs_.First(), sample), Homogeneous<5>(pairs_.Second(), sample));
}

double EssentialProblem::SquaredResidual(const Model& e, std::size_t i) const {
  return SquaredEpipolar(e, pairs_, i, residual_);
}

std::array<float, kRobustBlock> EssentialProblem::BlockResiduals(const Model& e, std::size_t begin) const {
  return EpipolarBlock(e, pairs_, begin, residual_);
}

std::optional<Eigen::Matrix3d> EssentialProblem::Refine(std::span<const std::uint32_t> items,
                                                        const Model& start) const {
  const Selection s = Select(pairs_, items);
  return RefineEssential(s.first, s.second, pairs_.Variances(), start,
                         {.max_iterations = 4, .relative_decrease = 1e-3});
}

FundamentalList FundamentalProblem::Solve(const std::array<std::uint32_t, 7>& sample) const {
  return SolveSevenPoint(Homogeneous<7>(pairs_.First(), sample), Homogeneous<7>(pairs_.Second(), sample));
}

double FundamentalProblem::SquaredResidual(const Model& f, std::size_t i) const {
  return SquaredEpipolar(f, pairs_, i, residual_);
}

std::array<float, kRobustBlock> FundamentalProblem::BlockResiduals(const Model& f, std::size_t begin) const {
  return EpipolarBlock(f, pairs_, begin, residual_);
}

std::optional<Eigen::Matrix3d> FundamentalProblem::Refine(std::span<const std::uint32_t> items,
                                                          const Model& start) const {
  constexpr int kRounds = 3;
  const Selection s = Select(pairs_, items);
  const CoordinateVariances& v = pairs_.Variances();
  std::vector<double> weights(items.size());
  std::optional<Eigen::Matrix3d> f = start;
  for (int round = 0; round < kRounds && f; ++round) {
    // 1 / D of the Sampson distance, at a scale at which the weights are about 1.
    for (std::size_t i = 0; i < items.size(); ++i) {
      const Eigen::Vector2d line = (*f * s.first[i].homogeneous()).head<2>();
      const Eigen::Vector2d back = (f->transpose() * s.second[i].homogeneous()).head<2>();
      const double d = v.first * back.squaredNorm() + v.second * line.squaredNorm();
      weights[i] = d > 0 ? (v.first + v.second) / d : 0;
    }
    f = SolveEightPoint(s.first, s.second, weights, EpipolarKind::kFundamental);
  }
  return f;
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
  const PointPairs::Block b = pairs_.BlockAt(begin);
  const FloatMatrix m(h.matrix), n(h.inverse);
  const float w1 = static_cast<float>(0.5 / pairs_.Variances().first),
              w2 = static_cast<float>(0.5 / pairs_.Variances().second);
  std::array<float, kRobustBlock> squared;
  for (std::size_t i = 0; i < kRobustBlock; ++i) {
    const float x1 = b.x1[i], y1 = b.y1[i], x2 = b.x2[i], y2 = b.y2[i];
    const float there_1 = m.m20 * x1 + m.m21 * y1 + m.m22, back_1 = n.m20 * x2 + n.m21 * y2 + n.m22;
    const float there_x = (m.m00 * x1 + m.m01 * y1 + m.m02) / there_1 - x2;
    const float there_y = (m.m10 * x1 + m.m11 * y1 + m.m12) / there_1 - y2;
    const float back_x = (n.m00 * x2 + n.m01 * y2 + n.m02) / back_1 - x1;
    const float back_y = (n.m10 * x2 + n.m11 * y2 + n.m12) / back_1 - y1;
    const float mean = w2 * (there_x * there_x + there_y * there_y) + w1 * (back_x * back_x + back_y * back_y);
    squared[i] = there_1 * back_1 > 0 ? mean : 1e30F;
  }
  return squared;
}

std::optional<Homography> HomographyProblem::Refine(std::span<const std::uint32_t> items, const Model&) const {
  const Selection s = Select(pairs_, items);
  const auto h = SolveHomographyLinear(s.first, s.second);
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
