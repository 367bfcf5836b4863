// Real roots of a polynomial of low degree by Sturm's theorem.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include "geometry/solvers/model_list.h"

namespace rilievo {
namespace real_roots_internal {

/// Sturm's chain in quotient form: f[i-1] = (slope[i] x + offset[i]) f[i] - scale[i] f[i+1], from p = f[0] of degree N
/// and its derivative f[1] down to the constant f[last]; leading coefficients are +-1, so scale > 0 keeps the signs.
template <int N>
struct SturmChain {
  std::array<double, N + 1> slope{}, offset{}, scale{};
  int last = 0;
  double last_value = 1;

  /// Sign changes along the chain at x.
  int Changes(double x) const {
    double next = 0, current = last_value;
    int changes = 0;
    for (int i = last; i >= 1; --i) {
      const double previous = (slope[i] * x + offset[i]) * current - scale[i] * next;
      changes += static_cast<int>(std::signbit(previous) != std::signbit(current));
      next = current;
      current = previous;
    }
    return changes;
  }
};

/// From monic p, coefficients by rising power. A remainder that vanishes (multiple roots) ends the chain early; then
/// the last polynomial is the common divisor, and since it divides all the others a constant stands for it.
template <int N>
SturmChain<N> MakeChain(const std::array<double, N + 1>& p) {
  SturmChain<N> chain;
  std::array<double, N + 1> a = p, b{};
  for (int k = 1; k <= N; ++k) b[k - 1] = p[k] * k / N;
  int degree = N;  // of a; b has one less
  double lead_a = 1, lead_b = 1;
  while (true) {
    const int i = ++chain.last;
    const double slope = lead_a * lead_b;
    const double offset = (a[degree - 1] - slope * (degree >= 2 ? b[degree - 2] : 0)) * lead_b;
    chain.slope[i] = slope;
    chain.offset[i] = offset;
    if (degree == 1) break;
    std::array<double, N + 1> negative_remainder{};
    double largest = 0;
    for (int k = 0; k <= degree - 2; ++k) {
      negative_remainder[k] = offset * b[k] + (k > 0 ? slope * b[k - 1] : 0) - a[k];
      largest = std::max(largest, std::abs(negative_remainder[k]));
    }
    const double scale = std::abs(negative_remainder[degree - 2]);
    if (!(scale > 1e-14 * largest) || scale < 1e-280) break;
    chain.scale[i] = scale;
    for (int k = 0; k <= degree - 2; ++k) negative_remainder[k] /= scale;
    a = b;
    b = negative_remainder;
    lead_a = lead_b;
    lead_b = b[degree - 2] > 0 ? 1 : -1;
    --degree;
  }
  chain.last_value = lead_b;
  return chain;
}

template <int N>
std::array<double, 2> ValueAndSlope(const std::array<double, N + 1>& p, double x) {
  double value = p[N], slope = 0;
  for (int k = N - 1; k >= 0; --k) {
    slope = slope * x + value;
    value = value * x + p[k];
  }
  return {value, slope};
}

/// The root that [low, high] holds: Newton's steps, halving where they leave the bracket.
template <int N>
double RefineRoot(const std::array<double, N + 1>& p, double low, double high) {
  const double value_low = ValueAndSlope<N>(p, low)[0];
  if (value_low == 0) return low;  // an end that is the root tells nothing by its sign
  if (ValueAndSlope<N>(p, high)[0] == 0) return high;
  const bool rising = value_low < 0;
  double x = 0.5 * (low + high);
  for (int i = 0; i < 80; ++i) {
    const auto [value, slope] = ValueAndSlope<N>(p, x);
    if (value == 0) return x;
    ((value < 0) == rising ? low : high) = x;
    double next = x - value / slope;
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    const double step = std::abs(next - x);
    x = next;
    if (step <= 4e-16 * std::abs(x) + 1e-300) break;
  }
  return x;
}

}  // namespace real_roots_internal

/// Distinct real roots of sum p[k] x^k in rising order; degree N (p[N] = 0 gives none: the caller's polynomial is
/// another one). Isolated by Sturm's theorem, refined by bracketed Newton; roots beyond 1e12 are left out.
template <int N>
ModelList<double, N> RealRoots(std::array<double, N + 1> p) {
  using namespace real_roots_internal;
  constexpr double kFar = 1e12;
  ModelList<double, N> roots;
  const double lead = p[N];
  if (lead == 0 || !std::isfinite(lead)) return roots;
  for (double& coefficient : p) {
    coefficient /= lead;
    if (!std::isfinite(coefficient)) return roots;
  }
  const SturmChain<N> chain = MakeChain<N>(p);

  struct Interval {
    double low, high;
    int changes_low, changes_high;
  };
  std::array<Interval, 80> stack;
  int size = 0;
  stack[size++] = {-kFar, kFar, chain.Changes(-kFar), chain.Changes(kFar)};
  while (size > 0) {
    const Interval range = stack[--size];
    const int count = range.changes_low - range.changes_high;
    if (count <= 0 || roots.size() == N) continue;
    const double width = range.high - range.low;
    const double magnitude = std::max(std::abs(range.low), std::abs(range.high));
    const bool settled = width <= 1e-14 * magnitude + 1e-300 || size + 2 > static_cast<int>(stack.size());
    if (settled || (count == 1 && magnitude < 1e4)) {
      const bool bracketed = ValueAndSlope<N>(p, range.low)[0] * ValueAndSlope<N>(p, range.high)[0] <= 0;
      if (settled || bracketed) {
        roots.Add(bracketed ? RefineRoot<N>(p, range.low, range.high) : 0.5 * (range.low + range.high));
        continue;
      }
    }
    // Halve the small ones; step outwards by factors where an end is far away.
    double middle = 0.5 * (range.low + range.high);
    if (range.low < -1 && range.high > 1) {
      middle = 0;
    } else if (range.low >= -1 && range.high > 8) {
      middle = std::min(middle, std::max(1.0, 4 * range.low));
    } else if (range.high <= 1 && range.low < -8) {
      middle = std::max(middle, std::min(-1.0, 4 * range.high));
    }
    const int changes = chain.Changes(middle);
    stack[size++] = {middle, range.high, changes, range.changes_high};
    stack[size++] = {range.low, middle, range.changes_low, changes};
  }
  return roots;
}

}  // namespace rilievo
