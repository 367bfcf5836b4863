// The kernels of FAST written once, over the lanes of a processor level (base/lanes_*.h): integers only. Included by
// fast_kernels_{scalar,avx2,avx512}.cc only.
#pragma once

#include <bit>

#include "stages/features/fast_kernels.h"

namespace rilievo::features {

namespace fast {

/// The circle of radius 3, clockwise from above.
inline constexpr int kCircleX[16] = {0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1};
inline constexpr int kCircleY[16] = {-3, -3, -2, -1, 0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3};

}  // namespace fast

/// Smallest brightness of the best arc of kArc neighbours, negative where there is none that is all brighter: with the
/// roles of minimum and maximum exchanged, minus that of the best darker one.
template <class L, int kArc, bool kBrighter>
typename L::S BestArc(const typename L::S* d) {
  using S = typename L::S;
  const auto weakest = [](S a, S b) { return kBrighter ? L::MinShorts(a, b) : L::MaxShorts(a, b); };
  const auto best = [](S a, S b) { return kBrighter ? L::MaxShorts(a, b) : L::MinShorts(a, b); };
  S two[16], four[16], result = d[0];
#pragma GCC unroll 16
  for (int i = 0; i < 16; ++i) two[i] = weakest(d[i], d[(i + 1) % 16]);
#pragma GCC unroll 16
  for (int i = 0; i < 16; ++i) four[i] = weakest(two[i], two[(i + 2) % 16]);
#pragma GCC unroll 16
  for (int i = 0; i < 16; ++i) {
    const S eight = weakest(four[i], four[(i + 4) % 16]);
    const S arc = kArc == 9 ? weakest(eight, d[(i + 8) % 16]) : weakest(eight, four[(i + 8) % 16]);
    result = i == 0 ? arc : best(result, arc);
  }
  return result;
}

template <class L, int kArc>
void ScoresOfArc(const fast::ScoreRow& row) {
  using S = typename L::S;
  const S floor = L::SetShorts(row.floor), zero = L::SetShorts(0);
  for (int x = 0; x < row.count; x += L::kShorts) {
    const S center = L::LoadShorts(row.rows[3] + x);
    const auto neighbor = [&](int i) {
      return L::SubShorts(L::LoadShorts(row.rows[3 + fast::kCircleY[i]] + x + fast::kCircleX[i]), center);
    };
    // An arc of 9 covers two neighbours of the four in line with the centre: their weaker one bounds the score.
    const S up = neighbor(0), right = neighbor(4), down = neighbor(8), left = neighbor(12);
    const S brighter = L::MinShorts(L::MaxShorts(up, down), L::MaxShorts(left, right));
    const S darker = L::MaxShorts(L::MinShorts(up, down), L::MinShorts(left, right));
    if (L::GreaterShorts(L::MaxShorts(brighter, L::SubShorts(zero, darker)), floor) == 0) {
      L::StoreShorts(row.out + x, floor);
      continue;
    }
    S d[16];
#pragma GCC unroll 16
    for (int i = 0; i < 16; ++i) d[i] = neighbor(i);
    const S score = L::MaxShorts(BestArc<L, kArc, true>(d), L::SubShorts(zero, BestArc<L, kArc, false>(d)));
    L::StoreShorts(row.out + x, L::MaxShorts(score, floor));
  }
}

template <class L>
void Scores(const fast::ScoreRow& row) {
  if (row.arc == 9) {
    ScoresOfArc<L, 9>(row);
  } else {
    ScoresOfArc<L, 12>(row);
  }
}

template <class L>
int Maxima(const fast::MaximaRow& row, std::int32_t* columns) {
  using S = typename L::S;
  const S floor = L::SetShorts(row.floor);
  int found = 0;
  for (int x = 0; x < row.count; x += L::kShorts) {
    const auto at = [&](int j, int dx) { return L::LoadShorts(row.rows[j] + x + dx); };
    const S value = at(1, 0);
    std::uint32_t bits = L::GreaterShorts(value, floor);
    if (bits == 0) continue;
    const S before = L::MaxShorts(L::MaxShorts(at(0, -1), at(0, 0)), L::MaxShorts(at(0, 1), at(1, -1)));
    const S after = L::MaxShorts(L::MaxShorts(at(2, -1), at(2, 0)), L::MaxShorts(at(2, 1), at(1, 1)));
    bits &= L::GreaterShorts(value, before) & ~L::GreaterShorts(after, value);
    if (row.count - x < L::kShorts) bits &= (1U << (row.count - x)) - 1;
    for (; bits != 0; bits &= bits - 1) columns[found++] = x + std::countr_zero(bits);
  }
  return found;
}

template <class L>
constexpr FastKernels MakeFastKernels(const char* name) {
  FastKernels kernels;
  kernels.name = name;
  kernels.scores = Scores<L>;
  kernels.maxima = Maxima<L>;
  return kernels;
}

}  // namespace rilievo::features
