// The robust loop: RANSAC, LMedS and MAPSAC over any model that a minimal sample determines.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "base/rng.h"
#include "geometry/robust/problem.h"
#include "geometry/robust/sampling.h"
#include "geometry/robust/scorer.h"

namespace rilievo {

template <class Model>
struct RobustEstimate {
  Model model;
  std::vector<std::uint32_t> inliers;  ///< ascending item indices whose residual is below `threshold`
  double cost = 0;       ///< RANSAC: outliers; MAPSAC: sum of min(r^2 / threshold^2, 1); LMedS: median of r^2
  double threshold = 0;  ///< the bound used: the given one, or 2.5 sigma0 of LMedS
  double sigma0 = 0;     ///< LMedS only: 1.4826 (1 + 5 / (n - p)) sqrt(median)
  int trials = 0;
};

namespace robust_internal {

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
