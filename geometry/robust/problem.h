// What the robust loop is told and what it needs of a problem.
#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "base/run_context.h"
#include "geometry/kernels/two_view_kernels.h"

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
concept SolvesBatches = requires(const P& p) {
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

}  // namespace rilievo
