// Costs of models in the robust loop: truncated sums or medians, and when to stop looking at a model.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "geometry/robust/problem.h"
#include "geometry/robust/sampling.h"

namespace rilievo::robust_internal {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Wald's sequential test of whether a model can be a good one (Matas & Chum, ICCV 2005): of a good model's items a
/// share of at least `good` agrees, of a wrong one's about `bad`. Rejects a good model once in kOdds at most, whatever
/// the true share of the wrong ones.
class SequentialTest {
 public:
  explicit SequentialTest(double good) {
    constexpr double kChance = 0.05;
    const double bad = std::min(kChance, 0.25 * good);
    per_outlier_ = std::log((1 - bad) / (1 - std::min(good, 0.99)));
    per_inlier_ = std::log(good / bad);
  }
  bool Rejects(double items, double inliers) const {
    constexpr double kOdds = 1000;
    static const double limit = std::log(kOdds);
    return (items - inliers) * per_outlier_ - inliers * per_inlier_ > limit;
  }

 private:
  double per_outlier_ = 0, per_inlier_ = 0;
};

/// Scores models of one problem and remembers the order of items and how many inliers make a model interesting.
template <RobustProblem P>
class Scorer {
 public:
  using Model = typename P::Model;
  Scorer(const P& problem, const RobustOptions& options, std::uint64_t seed)
      : problem_(problem), options_(options), n_(problem.Size()), test_(LeastShare()) {
    if constexpr (!kHasBlocks) order_ = ShuffledOrder(n_, seed);
    if (options_.estimator == RobustEstimator::kLmeds) residuals_.resize(n_ + kRobustBlock);
  }

  /// Cost of a model, or infinity as soon as it is known (or, when `hasty`, likely by the sequential test) not to be
  /// below `bound`.
  double Cost(const Model& model, double bound, bool hasty) {
    return options_.estimator == RobustEstimator::kLmeds ? MedianCost(model, bound)
                                                         : TruncatedCost(model, bound, hasty);
  }

  /// From now on a model is interesting when it has nearly as many inliers.
  void Expect(std::size_t inliers) {
    constexpr double kNearly = 0.7;  // of a refined model's inliers, what the sample of a good one has at first
    const double share = kNearly * static_cast<double>(inliers) / static_cast<double>(n_);
    if (share > LeastShare()) test_ = SequentialTest(share);
  }

  double Sigma0(double median) const {
    const double redundancy = std::max(1.0, static_cast<double>(n_) - P::kSampleSize);
    return 1.4826 * (1 + 5 / redundancy) * std::sqrt(median);
  }
  /// Bound of an inlier's residual for a model of this cost.
  double Threshold(double cost) const {
    if (options_.estimator != RobustEstimator::kLmeds) return options_.threshold;
    return std::max(2.5 * Sigma0(cost), options_.noise_floor);
  }

  std::vector<std::uint32_t> Inliers(const Model& model, double threshold) const {
    std::vector<std::uint32_t> inliers;
    for (std::size_t i = 0; i < n_; ++i) {
      if (problem_.SquaredResidual(model, i) <= threshold * threshold) inliers.push_back(static_cast<std::uint32_t>(i));
    }
    return inliers;
  }
  /// The same in the precision of scoring.
  std::vector<std::uint32_t> ScoredInliers(const Model& model, double threshold) const {
    if constexpr (!kHasBlocks) {
      return Inliers(model, threshold);
    } else {
      const float limit = static_cast<float>(threshold * threshold);
      std::vector<std::uint32_t> inliers(n_ + 1);
      std::size_t count = 0;
      for (std::size_t begin = 0; begin < n_; begin += kRobustBlock) {
        const std::array<float, kRobustBlock> squared = problem_.BlockResiduals(model, begin);
        const std::size_t end = std::min(kRobustBlock, n_ - begin);
        for (std::size_t i = 0; i < end; ++i) {
          inliers[count] = static_cast<std::uint32_t>(begin + i);
          count += squared[i] <= limit ? 1 : 0;
        }
      }
      inliers.resize(count);
      return inliers;
    }
  }

 private:
  static constexpr bool kHasBlocks = requires(const P& p, const Model& m) {
    { p.BlockResiduals(m, std::size_t{}) } -> std::same_as<std::array<float, kRobustBlock>>;
  };

  /// Half of the share of inliers below which not even one good sample is to be expected in all trials.
  double LeastShare() const { return 0.5 * std::pow(1.0 / std::max(2, options_.max_trials), 1.0 / P::kSampleSize); }

  std::array<float, kRobustBlock> Block(const Model& model, std::size_t begin) const {
    if constexpr (kHasBlocks) {
      return problem_.BlockResiduals(model, begin);
    } else {
      std::array<float, kRobustBlock> squared{};
      const std::size_t count = std::min(kRobustBlock, n_ - begin);
      for (std::size_t i = 0; i < count; ++i) {
        squared[i] = static_cast<float>(problem_.SquaredResidual(model, order_[begin + i]));
      }
      return squared;
    }
  }

  BlockScore Score(const std::array<float, kRobustBlock>& squared, int count, float limit) const {
    if constexpr (kHasBlocks) {
      return problem_.Truncate(squared, count, limit);
    } else {
      BlockScore score;
      for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
        const float share = squared[i] / limit;
        score.cost += share < 1 ? share : 1.0F;
        score.inliers += share < 1 ? 1 : 0;
      }
      return score;
    }
  }

  /// RANSAC: number of outliers. MAPSAC (Torr 2002): sum of min(r^2 / T^2, 1).
  double TruncatedCost(const Model& model, double bound, bool hasty) const {
    const float limit = static_cast<float>(options_.threshold * options_.threshold);
    const bool count_only = options_.estimator == RobustEstimator::kRansac;
    double cost = 0;
    std::size_t inliers = 0;
    for (std::size_t begin = 0; begin < n_; begin += kRobustBlock) {
      const std::size_t done = std::min(begin + kRobustBlock, n_);
      const BlockScore score = Score(Block(model, begin), static_cast<int>(done - begin), limit);
      inliers += static_cast<std::size_t>(score.inliers);
      cost = count_only ? static_cast<double>(done - inliers) : cost + static_cast<double>(score.cost);
      if (cost >= bound) return kInfinity;
      if (hasty && test_.Rejects(static_cast<double>(done), static_cast<double>(inliers))) return kInfinity;
    }
    return cost;
  }

  double MedianCost(const Model& model, double bound) {
    const std::size_t middle = n_ / 2;
    const float limit = bound < 1e30 ? static_cast<float>(bound) : 1e30F;
    std::size_t beyond = 0;
    for (std::size_t begin = 0; begin < n_; begin += kRobustBlock) {
      const std::array<float, kRobustBlock> squared = Block(model, begin);
      const std::size_t count = std::min(kRobustBlock, n_ - begin);
      for (std::size_t i = 0; i < count; ++i) {
        const bool below = squared[i] < limit;
        beyond += below ? 0 : 1;
        residuals_[begin + i] = below ? squared[i] : std::max(limit, std::min(squared[i], 1e30F));
      }
      if (beyond >= n_ - middle) return kInfinity;  // the middle one cannot be below the bound any more
    }
    const auto nth = residuals_.begin() + static_cast<std::ptrdiff_t>(middle);
    std::nth_element(residuals_.begin(), nth, residuals_.begin() + static_cast<std::ptrdiff_t>(n_));
    return *nth;
  }

  const P& problem_;
  const RobustOptions& options_;
  const std::size_t n_;
  SequentialTest test_;
  std::vector<std::uint32_t> order_;
  std::vector<float> residuals_;
};

}  // namespace rilievo::robust_internal
