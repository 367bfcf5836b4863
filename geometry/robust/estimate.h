// The robust loop: RANSAC, LMedS and MAPSAC over any model that a minimal sample determines.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "base/rng.h"
#include "base/run_context.h"
#include "geometry/kernels/two_view_kernels.h"
#include "geometry/robust/sampling.h"
#include "geometry/solvers/model_list.h"

namespace rilievo {

enum class RobustEstimator { kRansac, kLmeds, kMapsac };

struct RobustOptions {
  RobustEstimator estimator = RobustEstimator::kMapsac;
  double threshold = 1;  ///< bound of an inlier's residual, in the residual's unit; unused by LMedS
  double noise_floor =
      0;  ///< LMedS: residuals below this are inliers however small the median (rounding, quantisation)
  double confidence = 0.9999;  ///< of having drawn a sample free of outliers
  int min_trials = 1;
  int max_trials = 10000;
  const RunContext* context = nullptr;  ///< polled for stop requests (throws Cancelled) when given
};

template <class Model>
struct RobustEstimate {
  Model model;
  std::vector<std::uint32_t> inliers;  ///< ascending item indices whose residual is below `threshold`
  double cost = 0;       ///< RANSAC: outliers; MAPSAC: sum of min(r^2 / threshold^2, 1); LMedS: median of r^2
  double threshold = 0;  ///< the bound used: the given one, or 2.5 sigma0 of LMedS
  double sigma0 = 0;     ///< LMedS only: 1.4826 (1 + 5 / (n - p)) sqrt(median)
  int trials = 0;
};

/// What the loop needs of a problem with items 0 .. Size() - 1:
///   Model                          default constructible, copyable
///   kSampleSize                    items a minimal solution needs
///   Solve(sample) -> ModelList     the (possibly no) models of that many items
///   SquaredResidual(model, i)      r^2 of item i (non-negative; NaN counts as outlier)
///   Refine(items, start) -> optional<Model>   best model of many items (at least kSampleSize), starting from `start`
/// In the place of Solve a problem may have kBatch and
///   SolveBatch(kBatch samples)     the models of all, in the order of the samples: size() and operator[]
/// A problem that also has
///   BlockResiduals(model, begin) -> array<float, kRobustBlock>   r^2 of items begin .. begin + kRobustBlock - 1
///   Truncate(squared, count, limit) -> BlockScore                score of the first `count` of these
/// (begin a multiple of kRobustBlock, values past Size() ignored) is scored by them, in its own item order, which must
/// then be random (ShuffledOrder): early rejection takes the first items for a fair sample of all.
template <class P>
concept SolvesBatches = requires(const P& p, std::size_t i) {
  {
    p.SolveBatch(std::array<std::array<std::uint32_t, static_cast<std::size_t>(P::kSampleSize)>,
                            static_cast<std::size_t>(P::kBatch)>{})
        .size()
    } -> std::convertible_to<int>;
};
template <class P>
concept SolvesSamples = requires(const P& p,
                                 std::array<std::uint32_t, static_cast<std::size_t>(P::kSampleSize)> sample) {
  { p.Solve(sample).size() } -> std::convertible_to<int>;
};
template <class P>
concept RobustProblem = (SolvesBatches<P> || SolvesSamples<P>)&&requires(const P& p, const typename P::Model& model,
                                                                         std::size_t i,
                                                                         std::span<const std::uint32_t> items) {
  { p.Size() } -> std::convertible_to<std::size_t>;
  { p.SquaredResidual(model, i) } -> std::convertible_to<double>;
  { p.Refine(items, model) } -> std::same_as<std::optional<typename P::Model>>;
};

inline constexpr std::size_t kRobustBlock = kPairBlock;

namespace robust_internal {

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

/// Samples that are drawn before their models are scored, and the models.
template <class P>
inline constexpr int kBatchOf = [] {
  if constexpr (SolvesBatches<P>) return P::kBatch;
  return 1;
}();

template <RobustProblem P>
auto DrawModels(const P& problem, std::uint32_t n, Rng& rng) {
  if constexpr (SolvesBatches<P>) {
    std::array<std::array<std::uint32_t, static_cast<std::size_t>(P::kSampleSize)>, static_cast<std::size_t>(P::kBatch)>
        samples;
    for (auto& sample : samples) sample = DrawSample<P::kSampleSize>(n, rng);
    return problem.SolveBatch(samples);
  } else {
    return problem.Solve(DrawSample<P::kSampleSize>(n, rng));
  }
}

/// Refits on the inliers and keeps the result while the cost falls.
template <RobustProblem P>
void Polish(const P& problem, Scorer<P>& scorer, int rounds, typename P::Model& model, double& cost) {
  for (int round = 0; round < rounds; ++round) {
    const auto inliers = scorer.ScoredInliers(model, scorer.Threshold(cost));
    if (inliers.size() <= static_cast<std::size_t>(P::kSampleSize)) return;
    const auto refined = problem.Refine(inliers, model);
    if (!refined) return;
    const double refined_cost = scorer.Cost(*refined, cost, false);
    if (!(refined_cost < cost)) return;
    const bool settled = refined_cost > 0.999 * cost;
    model = *refined;
    cost = refined_cost;
    if (settled) return;
  }
}

/// The closing least-squares fit of RANSAC and LMedS, whose costs do not tell a good fit from a better one. Kept unless
/// it loses more than a twentieth of the inliers.
template <RobustProblem P>
void RefitOnce(const P& problem, const Scorer<P>& scorer, RobustEstimate<typename P::Model>& result) {
  if (result.inliers.size() <= static_cast<std::size_t>(P::kSampleSize)) return;
  const auto refined = problem.Refine(result.inliers, result.model);
  if (!refined) return;
  auto inliers = scorer.Inliers(*refined, result.threshold);
  if (20 * inliers.size() < 19 * result.inliers.size()) return;
  result.model = *refined;
  result.inliers = std::move(inliers);
}

}  // namespace robust_internal

/// The best model of the problem's items, its inliers and cost; none when there are too few items or no sample gave
/// one.
///   RANSAC  least number of residuals beyond the threshold (Fischler & Bolles 1981)
///   MAPSAC  least sum of min(r^2, T^2) (Torr, IJCV 50(1), 2002)
///   LMedS   least median of r^2, then sigma0 and the items below 2.5 sigma0 (Rousseeuw & Leroy 1987); breaks down when
///   half
///           of the items are wrong
/// Each new best is refined on its inliers at once (locally optimised RANSAC, Chum, Matas & Kittler 2003). Trials adapt
/// to the inliers found, rounded up to whole batches; LMedS, whose inliers mean nothing before the end, draws what half
/// outliers need. The result depends on problem, options and seed only.
template <RobustProblem P>
std::optional<RobustEstimate<typename P::Model>> EstimateRobustly(const P& problem, const RobustOptions& options,
                                                                  std::uint64_t seed) {
  using Model = typename P::Model;
  constexpr int kLocalRounds = 3, kFinalRounds = 10, kPollInterval = 64;
  const std::size_t n = problem.Size();
  if (n < static_cast<std::size_t>(P::kSampleSize)) return std::nullopt;
  Rng rng(SeedFor(seed, 1));
  robust_internal::Scorer<P> scorer(problem, options, SeedFor(seed, 2));
  const bool lmeds = options.estimator == RobustEstimator::kLmeds;

  Model best{};
  double best_cost = robust_internal::kInfinity;
  int required =
      lmeds ? RequiredTrials(n - n / 2, n, P::kSampleSize, options.confidence, options.max_trials) : options.max_trials;
  int trial = 0;
  for (int batch = 0; trial < std::max(required, std::min(options.min_trials, options.max_trials)); ++batch) {
    if (options.context != nullptr && batch % kPollInterval == 0) options.context->ThrowIfStopped();
    const auto models = robust_internal::DrawModels(problem, static_cast<std::uint32_t>(n), rng);
    trial += robust_internal::kBatchOf<P>;
    bool improved = false;
    for (int i = 0; i < models.size(); ++i) {
      const Model& model = models[i];
      const double cost = scorer.Cost(model, best_cost, true);
      if (!(cost < best_cost)) continue;
      best = model;
      best_cost = cost;
      improved = true;
    }
    if (!improved) continue;
    robust_internal::Polish(problem, scorer, kLocalRounds, best, best_cost);
    if (lmeds) continue;
    const std::size_t inliers = scorer.ScoredInliers(best, options.threshold).size();
    required = RequiredTrials(inliers, n, P::kSampleSize, options.confidence, options.max_trials);
    scorer.Expect(inliers);
  }
  if (!(best_cost < robust_internal::kInfinity)) return std::nullopt;
  robust_internal::Polish(problem, scorer, kFinalRounds, best, best_cost);
  RobustEstimate<Model> result;
  result.model = best;
  result.cost = best_cost;
  result.threshold = scorer.Threshold(best_cost);
  result.trials = trial;
  if (lmeds) result.sigma0 = scorer.Sigma0(best_cost);
  result.inliers = scorer.Inliers(best, result.threshold);
  if (options.estimator != RobustEstimator::kMapsac) robust_internal::RefitOnce(problem, scorer, result);
  return result;
}

}  // namespace rilievo
