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
inline constexpr int kRootItems = kFivePointMost + kRootGroup;

/// Roots under search, an item each. Brackets are kept as s of z = s / (1 - |s|), which brings the line to (-1, 1),
/// where halving finds far roots as soon as near ones.
struct RootSearch {
  int size = 0;
  alignas(64) std::int32_t lane[kRootItems];
  alignas(64) double rank[kRootItems],
      changes_at_low[kRootItems];                        ///< which of its lane's roots, counted from the left
  alignas(64) double low[kRootItems], high[kRootItems];  ///< s of the bracket
  alignas(64) double below_low[kRootItems], below_high[kRootItems];  ///< roots of the lane below its ends
  alignas(64) double z[kRootItems], open[kRootItems];  ///< while `open` is 1 the present step has not settled the item
  std::int32_t origin[kRootItems];                     ///< item of the search that this one was taken from
};

inline constexpr double kFarRoot = 1e12;

template <class L>
typename L::D FromUnit(typename L::D s) {
  return s / (L::Set(1.0) - L::Abs(s));
}
template <class L>
typename L::D ToUnit(typename L::D z) {
  return z / (L::Set(1.0) + L::Abs(z));
}

/// Makes items past the last, up to a whole group, harmless.
inline void PadItems(RootSearch& search) {
  for (int k = search.size; k < search.size + kRootGroup; ++k) {
    search.lane[k] = 0;
    search.rank[k] = search.changes_at_low[k] = search.low[k] = search.high[k] = search.below_low[k] =
        search.below_high[k] = search.z[k] = search.open[k] = 0;
  }
}

/// Halves the brackets of a group until each holds one root, `rounds` times at most.
template <class L>
void IsolateGroup(const FivePointWork& work, int begin, int rounds, RootSearch& search) {
  using D = typename L::D;
  constexpr int kVectors = kRootGroup / L::kWidth;
  constexpr std::uint32_t kAll = (1U << L::kWidth) - 1;
  const ItemChains<L, kVectors> chains(work, search.lane + begin);
  const D zero = L::Set(0.0), half = L::Set(0.5), one = L::Set(1.0), several = L::Set(1.5);
  D low[kVectors], high[kVectors], below_low[kVectors], below_high[kVectors];
  for (int v = 0; v < kVectors; ++v) {
    const int at = begin + v * L::kWidth;
    low[v] = L::Load(search.low + at);
    high[v] = L::Load(search.high + at);
    below_low[v] = L::Load(search.below_low + at);
    below_high[v] = L::Load(search.below_high + at);
  }
  for (int round = 0; round < rounds; ++round) {
    std::uint32_t open = 0;
    for (int v = 0; v < kVectors; ++v) open |= L::Bits(L::Less(several, below_high[v] - below_low[v])) & kAll;
    if (open == 0) break;
    D middle[kVectors], z[kVectors], changes[kVectors];
    for (int v = 0; v < kVectors; ++v) {
      middle[v] = half * (low[v] + high[v]);
      z[v] = FromUnit<L>(middle[v]);
    }
    chains.Changes(z, changes);
    for (int v = 0; v < kVectors; ++v) {
      const D below = L::Load(search.changes_at_low + begin + v * L::kWidth) - changes[v];
      const D rank = L::Load(search.rank + begin + v * L::kWidth) + half;
      const auto is_open = L::Less(several, below_high[v] - below_low[v]);
      const auto up = L::And(is_open, L::Less(below, rank)), down = L::And(is_open, L::Less(rank, below));
      low[v] = L::Select(up, middle[v], low[v]);
      below_low[v] = L::Select(up, below, below_low[v]);
      high[v] = L::Select(down, middle[v], high[v]);
      below_high[v] = L::Select(down, below, below_high[v]);
    }
  }
  for (int v = 0; v < kVectors; ++v) {
    const int at = begin + v * L::kWidth;
    L::Store(search.low + at, low[v]);
    L::Store(search.high + at, high[v]);
    L::Store(search.below_low + at, below_low[v]);
    L::Store(search.below_high + at, below_high[v]);
    L::Store(search.open + at, L::Select(L::Less(several, below_high[v] - below_low[v]), one, zero));
  }
}

/// Before the first step: z in the middle of the bracket; open where the polynomial's sign changes along it.
template <class L>
void StartGroup(const FivePointWork& work, int begin, RootSearch& search) {
  using D = typename L::D;
  constexpr int kVectors = kRootGroup / L::kWidth;
  const ItemChains<L, kVectors> chains(work, search.lane + begin);
  D z[kVectors], value_low[kVectors], value_high[kVectors], unused[kVectors];
  for (int v = 0; v < kVectors; ++v) z[v] = FromUnit<L>(L::Load(search.low + begin + v * L::kWidth));
  chains.ValueAndSlope(z, value_low, unused);
  for (int v = 0; v < kVectors; ++v) z[v] = FromUnit<L>(L::Load(search.high + begin + v * L::kWidth));
  chains.ValueAndSlope(z, value_high, unused);
  const D zero = L::Set(0.0), half = L::Set(0.5), one = L::Set(1.0);
  for (int v = 0; v < kVectors; ++v) {
    const int at = begin + v * L::kWidth;
    const auto not_zero = L::And(L::Less(zero, L::Abs(value_low[v])), L::Less(zero, L::Abs(value_high[v])));
    const auto isolated = L::Less(L::Load(search.open + at), half);
    const auto brackets = L::And(L::SignsDiffer(value_low[v], value_high[v]), L::And(not_zero, isolated));
    L::Store(search.open + at, L::Select(brackets, one, zero));
    L::Store(search.below_low + at, L::Select(L::SignsDiffer(value_low[v], one), zero - one, one));  // sign at low
    L::Store(search.z + at, FromUnit<L>(half * (L::Load(search.low + at) + L::Load(search.high + at))));
  }
}

/// Newton's steps of a group, halving where they leave the bracket, until they are small (what remains is left to
/// polishing), `rounds` times at most.
template <class L>
void RefineGroup(const FivePointWork& work, int begin, int rounds, RootSearch& search) {
  using D = typename L::D;
  constexpr int kVectors = kRootGroup / L::kWidth;
  constexpr std::uint32_t kAll = (1U << L::kWidth) - 1;
  const ItemChains<L, kVectors> chains(work, search.lane + begin);
  const D zero = L::Set(0.0), half = L::Set(0.5), one = L::Set(1.0), small = L::Set(1e-6);
  D z[kVectors], low[kVectors], high[kVectors], sign[kVectors];
  decltype(L::Less(zero, one)) open[kVectors];
  for (int v = 0; v < kVectors; ++v) {
    const int at = begin + v * L::kWidth;
    z[v] = L::Load(search.z + at);
    low[v] = FromUnit<L>(L::Load(search.low + at));
    high[v] = FromUnit<L>(L::Load(search.high + at));
    sign[v] = L::Load(search.below_low + at);
    open[v] = L::Less(half, L::Load(search.open + at));
  }
  for (int round = 0; round < rounds; ++round) {
    D value[kVectors], derivative[kVectors];
    chains.ValueAndSlope(z, value, derivative);
    std::uint32_t still = 0;
    for (int v = 0; v < kVectors; ++v) {
      const auto left = L::SignsDiffer(value[v], sign[v]);  // the root is left of z
      high[v] = L::Select(L::And(open[v], left), z[v], high[v]);
      low[v] = L::Select(open[v], L::Select(left, low[v], z[v]), low[v]);
      D next = z[v] - value[v] / derivative[v];
      const auto inside = L::And(L::Less(low[v], next), L::Less(next, high[v]));
      if ((L::Bits(inside) & kAll) != kAll) {
        next = L::Select(inside, next, FromUnit<L>(half * (ToUnit<L>(low[v]) + ToUnit<L>(high[v]))));
      }
      const D step = L::Abs(next - z[v]);
      z[v] = L::Select(open[v], next, z[v]);
      open[v] = L::And(open[v], L::Less(small * L::Abs(next), step));
      still |= L::Bits(open[v]) & kAll;
    }
    if (still == 0) break;
  }
  for (int v = 0; v < kVectors; ++v) {
    const int at = begin + v * L::kWidth;
    L::Store(search.z + at, z[v]);
    L::Store(search.low + at, ToUnit<L>(low[v]));
    L::Store(search.high + at, ToUnit<L>(high[v]));
    L::Store(search.open + at, L::Select(open[v], one, zero));
  }
}

inline void CopyItem(const RootSearch& from, int i, RootSearch& to, int k) {
  to.lane[k] = from.lane[i];
  to.rank[k] = from.rank[i];
  to.changes_at_low[k] = from.changes_at_low[i];
  to.low[k] = from.low[i];
  to.high[k] = from.high[i];
  to.below_low[k] = from.below_low[i];
  to.below_high[k] = from.below_high[i];
  to.z[k] = from.z[i];
  to.open[k] = from.open[i];
}

/// A few rounds for all items, then the many rounds that a few need for those alone.
template <class L>
void InTwoTurns(const FivePointWork& work, void (*group)(const FivePointWork&, int, int, RootSearch&), int few,
                int many, RootSearch& search) {
  for (int begin = 0; begin < search.size; begin += kRootGroup) group(work, begin, few, search);
  RootSearch rest;
  for (int k = 0; k < search.size; ++k) {
    if (search.open[k] == 0) continue;
    rest.origin[rest.size] = k;
    CopyItem(search, k, rest, rest.size++);
  }
  PadItems(rest);
  for (int begin = 0; begin < rest.size; begin += kRootGroup) group(work, begin, many, rest);
  for (int k = 0; k < rest.size; ++k) CopyItem(rest, k, search, rest.origin[k]);
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
  constexpr double kEnd = kFarRoot / (1 + kFarRoot);
  RootSearch search;
  bool special[kFivePointBatch];
  for (int lane = 0; lane < kFivePointBatch; ++lane) {
    roots.count[lane] = 0;
    special[lane] = work.regular[lane] == 0;
    const int count = special[lane] ? 0 : static_cast<int>(at_low[lane] - at_high[lane]);
    for (int k = 0; k < count; ++k) {
      const int item = search.size++;
      search.lane[item] = lane;
      search.rank[item] = k;
      search.changes_at_low[item] = at_low[lane];
      search.low[item] = -kEnd;
      search.high[item] = kEnd;
      search.below_low[item] = 0;
      search.below_high[item] = count;
      search.z[item] = search.open[item] = 0;
    }
  }
  PadItems(search);
  InTwoTurns<L>(work, IsolateGroup<L>, 5, 24, search);
  for (int begin = 0; begin < search.size; begin += kRootGroup) StartGroup<L>(work, begin, search);
  for (int k = 0; k < search.size; ++k) {
    if (search.open[k] == 0) special[search.lane[k]] = true;
  }
  InTwoTurns<L>(work, RefineGroup<L>, 5, 60, search);
  for (int k = 0; k < search.size; ++k) roots.z[search.lane[k]][roots.count[search.lane[k]]++] = search.z[k];
  for (int lane = 0; lane < kFivePointBatch; ++lane) {
    if (!special[lane]) continue;
    double polynomial[11];
    for (int k = 0; k < 11; ++k) polynomial[k] = work.polynomial[k][lane];
    roots.count[lane] = RootsOfDegreeTen(polynomial, roots.z[lane]);
  }
}

}  // namespace rilievo::kernels
