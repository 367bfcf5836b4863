// Weight functions of an adjustment.
#pragma once

#include <cmath>

namespace rilievo::adjustment {

enum class Loss { kLeastSquares, kHuber, kCauchy };

/// rho(s) of a squared residual s and its derivative: the weight of the residual (IRLS).
struct LossValue {
  double rho = 0, weight = 1;
};

inline LossValue Evaluate(Loss loss, double scale, double squared) {
  const double limit = scale * scale;
  if (loss == Loss::kCauchy) return {limit * std::log1p(squared / limit), 1 / (1 + squared / limit)};
  if (loss == Loss::kHuber && squared > limit) {
    const double r = std::sqrt(squared);
    return {2 * scale * r - limit, scale / r};
  }
  return {squared, 1};
}

}  // namespace rilievo::adjustment
