// Real roots of the polynomials of eight five-point samples over lanes: Sturm's theorem isolates, Newton refines.
#pragma once

#include "geometry/kernels/five_point_algebra_impl.h"

namespace rilievo::kernels {

struct LaneRoots {
  int count[kFivePointBatch];
  double z[kFivePointBatch][10];  ///< ascending
};

/// The same by the scalar method (real_roots.h), which knows what to do with multiple roots: for lanes that are
/// special. `polynomial` by rising power; returns the number of roots.
int RootsOfDegreeTen(const double (&polynomial)[11], double (&roots)[10]);

/// Sturm's chain in quotient form, f[i-1] = (slope[i] x + offset[i]) f[i] - scale[i] f[i+1] (see real_roots.h). Where a
/// remainder vanishes the lane is not regular.
template <class L>
void MakeChain(int begin, FivePointWork& work) {
  using D = typename L::D;
  const D zero = L::Set(0.0), one = L::Set(1.0), minus_one = L::Set(-1.0);
  D a[11], b[11];
  const D inverse = one / L::Load(work.polynomial[10] + begin);
  for (int k = 0; k < 10; ++k) a[k] = L::Load(work.polynomial[k] + begin) * inverse;
  a[10] = one;
  for (int k = 1; k <= 10; ++k) b[k - 1] = a[k] * L::Set(0.1 * k);
  b[9] = one;
  D lead_a = one, lead_b = one;
  auto regular = L::Less(zero, one);
  for (int i = 0; i < 10; ++i) {
    const int degree = 10 - i;
    const D slope = lead_a * lead_b;
    const D offset = (a[degree - 1] - (degree >= 2 ? slope * b[degree - 2] : zero)) * lead_b;
    L::Store(work.slope[i] + begin, slope);
    L::Store(work.offset[i] + begin, offset);
    D rest[11], largest = zero;
    for (int k = 0; k <= degree - 2; ++k) {
      rest[k] = (k > 0 ? offset * b[k] + slope * b[k - 1] : offset * b[k]) - a[k];
      const D size = L::Abs(rest[k]);
      largest = L::Select(L::Less(largest, size), size, largest);
    }
    if (degree == 1) {
      L::Store(work.scale[i] + begin, zero);
      regular = L::And(regular, L::Less(L::Abs(offset), L::Set(1e280)));
      break;
    }
    const D scale = L::Abs(rest[degree - 2]);
    regular = L::And(regular, L::And(L::Less(L::Set(1e-14) * largest, scale), L::Less(L::Set(1e-280), scale)));
    L::Store(work.scale[i] + begin, scale);
    const D divide = one / scale;
    for (int k = 0; k <= degree - 2; ++k) {
      const D next = rest[k] * divide;
      a[k] = b[k];
      b[k] = next;
    }
    a[degree - 1] = b[degree - 1];
    lead_a = lead_b;
    lead_b = L::Select(L::Less(zero, rest[degree - 2]), one, minus_one);
    b[degree - 2] = lead_b;
  }
  L::Store(work.last + begin, lead_b);
  L::Store(work.regular + begin, L::Select(regular, one, zero));
}

/// The chains and polynomials of kVectors vectors of roots.
template <class L, int kVectors>
struct ItemChains {
  using D = typename L::D;
  D slope[10][kVectors], offset[10][kVectors], scale[10][kVectors], last[kVectors], p[11][kVectors];

  ItemChains(const FivePointWork& work, const std::int32_t* lanes) {
    for (int v = 0; v < kVectors; ++v) {
      const auto lane = L::LoadIndex(lanes + v * L::kWidth);
      for (int i = 0; i < 10; ++i) {
        slope[i][v] = L::Pick(work.slope[i], lane);
        offset[i][v] = L::Pick(work.offset[i], lane);
        scale[i][v] = L::Pick(work.scale[i], lane);
      }
      last[v] = L::Pick(work.last, lane);
      for (int k = 0; k < 11; ++k) p[k][v] = L::Pick(work.polynomial[k], lane);
    }
  }

  /// Sign changes along the chains at z.
  void Changes(const D (&z)[kVectors], D (&changes)[kVectors]) const {
    const D zero = L::Set(0.0), one = L::Set(1.0);
    D next[kVectors], current[kVectors];
    for (int v = 0; v < kVectors; ++v) {
      next[v] = changes[v] = zero;
      current[v] = last[v];
    }
    for (int i = 9; i >= 0; --i) {
      for (int v = 0; v < kVectors; ++v) {
        const D previous = (slope[i][v] * z[v] + offset[i][v]) * current[v] - scale[i][v] * next[v];
        changes[v] = changes[v] + L::Select(L::SignsDiffer(previous, current[v]), one, zero);
        next[v] = current[v];
        current[v] = previous;
      }
    }
  }

  void ValueAndSlope(const D (&z)[kVectors], D (&value)[kVectors], D (&derivative)[kVectors]) const {
    for (int v = 0; v < kVectors; ++v) {
      value[v] = p[10][v];
      derivative[v] = L::Set(0.0);
    }
    for (int k = 9; k >= 0; --k) {
      for (int v = 0; v < kVectors; ++v) {
        derivative[v] = derivative[v] * z[v] + value[v];
        value[v] = value[v] * z[v] + p[k][v];
      }
    }
  }
};

/// Roots that are worked on together: two vectors at a time keep the units busy while one waits for its results.
inline constexpr int kRootGroup = 16;

struct RootSearch {
  int size = 0;
  alignas(64) std::int32_t lane[kFivePointMost + kRootGroup];
  alignas(64) double rank[kFivePointMost + kRootGroup], roots[kFivePointMost + kRootGroup],
      changes_at_low[kFivePointMost + kRootGroup];
  alignas(64) double z[kFivePointMost + kRootGroup], found[kFivePointMost + kRootGroup];
};

inline constexpr double kFarRoot = 1e12;

/// z = s / (1 - |s|) brings the line to (-1, 1), where halving finds far roots as soon as near ones.
template <class L>
typename L::D FromUnit(typename L::D s) {
  return s / (L::Set(1.0) - L::Abs(s));
}

/// The roots of search items [begin, begin + kRootGroup).
template <class L>
void SearchGroup(const FivePointWork& work, int begin, RootSearch& search) {
  using D = typename L::D;
  constexpr int kVectors = kRootGroup / L::kWidth, kHalvings = 24, kSteps = 60;
  constexpr std::uint32_t kAll = (1U << L::kWidth) - 1;
  const ItemChains<L, kVectors> chains(work, search.lane + begin);
  const D zero = L::Set(0.0), half = L::Set(0.5), one = L::Set(1.0), end = L::Set(kFarRoot / (1 + kFarRoot));
  D low[kVectors], high[kVectors], below_low[kVectors], below_high[kVectors], rank[kVectors], first[kVectors];
  for (int v = 0; v < kVectors; ++v) {
    const int at = begin + v * L::kWidth;
    low[v] = zero - end;
    high[v] = end;
    below_low[v] = zero;
    below_high[v] = L::Load(search.roots + at);
    rank[v] = L::Load(search.rank + at);
    first[v] = L::Load(search.changes_at_low + at);
  }
  for (int round = 0; round < kHalvings; ++round) {
    std::uint32_t open = 0;
    for (int v = 0; v < kVectors; ++v) open |= L::Bits(L::Less(L::Set(1.5), below_high[v] - below_low[v])) & kAll;
    if (open == 0) break;
    D middle[kVectors], z[kVectors], changes[kVectors];
    for (int v = 0; v < kVectors; ++v) {
      middle[v] = half * (low[v] + high[v]);
      z[v] = FromUnit<L>(middle[v]);
    }
    chains.Changes(z, changes);
    for (int v = 0; v < kVectors; ++v) {
      const D below = first[v] - changes[v];
      const auto is_open = L::Less(L::Set(1.5), below_high[v] - below_low[v]);
      const auto up = L::And(is_open, L::Less(below, rank[v] + half)),
                 down = L::And(is_open, L::Less(rank[v] + half, below));
      low[v] = L::Select(up, middle[v], low[v]);
      below_low[v] = L::Select(up, below, below_low[v]);
      high[v] = L::Select(down, middle[v], high[v]);
      below_high[v] = L::Select(down, below, below_high[v]);
    }
  }
  // Newton's steps, halving where they leave the bracket.
  D z[kVectors], value[kVectors], derivative[kVectors], value_low[kVectors];
  for (int v = 0; v < kVectors; ++v) z[v] = FromUnit<L>(high[v]);
  chains.ValueAndSlope(z, value, derivative);
  for (int v = 0; v < kVectors; ++v) z[v] = FromUnit<L>(low[v]);
  chains.ValueAndSlope(z, value_low, derivative);
  decltype(L::Less(zero, one)) active[kVectors];
  for (int v = 0; v < kVectors; ++v) {
    active[v] = L::And(L::SignsDiffer(value[v], value_low[v]), L::Less(below_high[v] - below_low[v], L::Set(1.5)));
    L::Store(search.found + begin + v * L::kWidth, L::Select(active[v], one, zero));
    z[v] = FromUnit<L>(half * (low[v] + high[v]));
  }
  for (int round = 0; round < kSteps; ++round) {
    chains.ValueAndSlope(z, value, derivative);
    std::uint32_t open = 0;
    for (int v = 0; v < kVectors; ++v) {
      const D s = z[v] / (one + L::Abs(z[v]));
      const auto left = L::SignsDiffer(value[v], value_low[v]);  // the root is left of z
      high[v] = L::Select(left, s, high[v]);
      low[v] = L::Select(left, low[v], s);
      D next = z[v] - value[v] / derivative[v];
      const D next_s = next / (one + L::Abs(next));
      next = L::Select(L::And(L::Less(low[v], next_s), L::Less(next_s, high[v])), next,
                       FromUnit<L>(half * (low[v] + high[v])));
      const D step = L::Abs(next - z[v]);
      z[v] = L::Select(active[v], next, z[v]);
      active[v] = L::And(active[v], L::Less(L::Set(1e-9) * L::Abs(next), step));
      open |= L::Bits(active[v]) & kAll;
    }
    if (open == 0) break;
  }
  for (int v = 0; v < kVectors; ++v) L::Store(search.z + begin + v * L::kWidth, z[v]);
}

/// Sign changes at both ends of every lane's chain.
template <class L>
void CountRoots(const FivePointWork& work, double (&at_low)[kFivePointBatch], double (&at_high)[kFivePointBatch]) {
  constexpr int kVectors = kFivePointBatch / L::kWidth;
  static constexpr std::int32_t kLanes[kFivePointBatch] = {0, 1, 2, 3, 4, 5, 6, 7};
  const ItemChains<L, kVectors> chains(work, kLanes);
  typename L::D z[kVectors], changes[kVectors];
  for (const double side : {-1.0, 1.0}) {
    for (int v = 0; v < kVectors; ++v) z[v] = L::Set(side * kFarRoot);
    chains.Changes(z, changes);
    for (int v = 0; v < kVectors; ++v) L::Store((side < 0 ? at_low : at_high) + v * L::kWidth, changes[v]);
  }
}

template <class L>
void FindRoots(const FivePointWork& work, LaneRoots& roots) {
  double at_low[kFivePointBatch], at_high[kFivePointBatch];
  CountRoots<L>(work, at_low, at_high);
  RootSearch search;
  for (int lane = 0; lane < kFivePointBatch; ++lane) {
    const double count = at_low[lane] - at_high[lane];
    if (work.regular[lane] == 0 || !(count > 0)) continue;
    for (int k = 0; k < static_cast<int>(count); ++k) {
      search.lane[search.size] = lane;
      search.rank[search.size] = k;
      search.roots[search.size] = count;
      search.changes_at_low[search.size++] = at_low[lane];
    }
  }
  for (int k = search.size; k < search.size + kRootGroup; ++k) {
    search.lane[k] = 0;
    search.rank[k] = search.roots[k] = search.changes_at_low[k] = 0;
  }
  for (int begin = 0; begin < search.size; begin += kRootGroup) SearchGroup<L>(work, begin, search);
  bool special[kFivePointBatch];
  for (int lane = 0; lane < kFivePointBatch; ++lane) {
    special[lane] = work.regular[lane] == 0;
    roots.count[lane] = 0;
  }
  for (int k = 0; k < search.size; ++k) {
    const int lane = search.lane[k];
    special[lane] = special[lane] || search.found[k] == 0;
    roots.z[lane][roots.count[lane]++] = search.z[k];
  }
  for (int lane = 0; lane < kFivePointBatch; ++lane) {
    if (!special[lane]) continue;
    double polynomial[11];
    for (int k = 0; k < 11; ++k) polynomial[k] = work.polynomial[k][lane];
    roots.count[lane] = RootsOfDegreeTen(polynomial, roots.z[lane]);
  }
}

}  // namespace rilievo::kernels
