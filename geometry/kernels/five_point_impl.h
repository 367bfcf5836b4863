// Nistér's five-point solver (PAMI 26(6), 2004) for eight samples at a time, written once over the lanes of a processor
// level: a lane is a sample until the polynomials stand, then a root. Lanes never mix and each stops changing once it
// has converged, so that neither the width nor a neighbour shows (docs/decisions/0009).
#pragma once

#include "geometry/kernels/five_point_algebra_impl.h"
#include "geometry/kernels/five_point_roots_impl.h"
#include "geometry/kernels/two_view_kernels.h"

namespace rilievo::kernels {

/// Roots of all lanes, padded to whole groups of vectors.
struct RootItems {
  int size = 0;
  alignas(64) std::int32_t lane[kFivePointMost + 16];
  alignas(64) double z[kFivePointMost + 16];
};

/// Essential matrices before polishing: coordinates in the basis of the null space, norm 1.
struct Candidates {
  int size = 0;
  alignas(64) std::int32_t lane[kFivePointMost + 16];
  alignas(64) double c[4][kFivePointMost + 16];
};

/// E = sum of c[i] basis[i], row-major.
template <class L>
void Combine(const typename L::D (&basis)[36], const typename L::D (&c)[4], typename L::D (&e)[9]) {
  for (int k = 0; k < 9; ++k)
    e[k] = (c[0] * basis[k] + c[1] * basis[9 + k]) + (c[2] * basis[18 + k] + c[3] * basis[27 + k]);
}

template <class L>
void PickBasis(const FivePointWork& work, typename L::Index lane, typename L::D (&basis)[36]) {
  for (int k = 0; k < 36; ++k) basis[k] = L::Pick(work.basis[k], lane);
}

/// c ~ (x, y, z, 1) of a root z: the null vector of B(z), from the two rows that determine it best.
template <class L>
void BackSubstitute(const FivePointWork& work, typename L::Index lane, typename L::D z, typename L::D (&c)[4]) {
  using D = typename L::D;
  D r[3][3];
  for (int i = 0; i < 3; ++i) {
    const double(*p)[kFivePointBatch] = work.rows + 13 * i;
    const auto at = [&](int k) { return L::Pick(p[k], lane); };
    r[i][0] = ((at(3) * z + at(2)) * z + at(1)) * z + at(0);
    r[i][1] = ((at(7) * z + at(6)) * z + at(5)) * z + at(4);
    r[i][2] = (((at(12) * z + at(11)) * z + at(10)) * z + at(9)) * z + at(8);
  }
  D best[3], best_norm = L::Set(-1.0);
  for (int k = 0; k < 3; ++k) best[k] = L::Set(0.0);
  for (int i = 0; i < 3; ++i) {
    const D *p = r[i], *q = r[(i + 1) % 3];
    const D cross[3] = {p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]};
    const D norm = cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2];
    const auto better = L::Less(best_norm, norm);
    for (int k = 0; k < 3; ++k) best[k] = L::Select(better, cross[k], best[k]);
    best_norm = L::Select(better, norm, best_norm);
  }
  const D v[4] = {best[0], best[1], z * best[2], best[2]};
  const D inverse = L::Set(1.0) / L::Sqrt((v[0] * v[0] + v[1] * v[1]) + (v[2] * v[2] + v[3] * v[3]));
  for (int k = 0; k < 4; ++k) c[k] = v[k] * inverse;
}

/// Whether (e x second) . (E first) has one sign for all five points, e the epipole of the second image: else no pose
/// of E has all five in front of both cameras (Chum, Werner & Matas, ICPR 2004).
template <class L>
typename L::M IsOriented(const FivePointSamples& samples, typename L::Index lane, const typename L::D (&e)[9]) {
  using D = typename L::D;
  D epipole[3], best_norm = L::Set(-1.0);
  for (int k = 0; k < 3; ++k) epipole[k] = L::Set(0.0);
  for (int i = 0; i < 3; ++i) {  // perpendicular to two columns of E
    const int j = (i + 1) % 3;
    const D cross[3] = {e[3 + i] * e[6 + j] - e[6 + i] * e[3 + j], e[6 + i] * e[j] - e[i] * e[6 + j],
                        e[i] * e[3 + j] - e[3 + i] * e[j]};
    const D norm = cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2];
    const auto better = L::Less(best_norm, norm);
    for (int k = 0; k < 3; ++k) epipole[k] = L::Select(better, cross[k], epipole[k]);
    best_norm = L::Select(better, norm, best_norm);
  }
  const D zero = L::Set(0.0), one = L::Set(1.0);
  D positive = zero;
  for (int i = 0; i < 5; ++i) {
    const D x1 = L::Pick(samples.rows[i], lane), y1 = L::Pick(samples.rows[5 + i], lane);
    const D x2 = L::Pick(samples.rows[10 + i], lane), y2 = L::Pick(samples.rows[15 + i], lane);
    const D line[3] = {e[0] * x1 + e[1] * y1 + e[2], e[3] * x1 + e[4] * y1 + e[5], e[6] * x1 + e[7] * y1 + e[8]};
    const D side = (epipole[1] - epipole[2] * y2) * line[0] + (epipole[2] * x2 - epipole[0]) * line[1] +
                   (epipole[0] * y2 - epipole[1] * x2) * line[2];
    positive = positive + L::Select(L::Less(zero, side), one, zero);
  }
  return L::Or(L::Less(positive, L::Set(0.5)), L::Less(L::Set(4.5), positive));
}

template <class L, bool kOriented>
void MakeCandidates(const FivePointSamples& samples, const FivePointWork& work, const RootItems& items,
                    Candidates& candidates) {
  using D = typename L::D;
  for (int begin = 0; begin < items.size; begin += L::kWidth) {
    const auto lane = L::LoadIndex(items.lane + begin);
    D c[4];
    BackSubstitute<L>(work, lane, L::Load(items.z + begin), c);
    std::uint32_t wanted = ~0U;
    if constexpr (kOriented) {
      D basis[36], e[9];
      PickBasis<L>(work, lane, basis);
      Combine<L>(basis, c, e);
      wanted = L::Bits(IsOriented<L>(samples, lane, e));
    }
    double coordinates[4][L::kWidth];
    for (int k = 0; k < 4; ++k) L::Store(coordinates[k], c[k]);
    for (int i = 0; i < L::kWidth && begin + i < items.size; ++i) {
      if ((wanted >> i & 1) == 0) continue;
      candidates.lane[candidates.size] = items.lane[begin + i];
      for (int k = 0; k < 4; ++k) candidates.c[k][candidates.size] = coordinates[k][i];
      ++candidates.size;
    }
  }
}

/// Polishes the candidates and keeps those that obey the constraints (NaN fails, too).
template <class L>
void Finish(const FivePointWork& work, Candidates& candidates, FivePointModels& models) {
  using D = typename L::D;
  constexpr double kMostError = 1e-20;
  for (int k = candidates.size; k < candidates.size + L::kWidth; ++k) {
    candidates.lane[k] = 0;
    for (auto& c : candidates.c) c[k] = 0;
  }
  for (int begin = 0; begin < candidates.size; begin += L::kWidth) {
    D basis[36], c[4], e[9];
    PickBasis<L>(work, L::LoadIndex(candidates.lane + begin), basis);
    for (int k = 0; k < 4; ++k) c[k] = L::Load(candidates.c[k] + begin);
    PolishEssential<L>(basis, c, e);
    const std::uint32_t valid = L::Bits(L::Less(ConstraintError<L>(e), L::Set(kMostError)));
    double matrices[9][L::kWidth];
    for (int k = 0; k < 9; ++k) L::Store(matrices[k], e[k]);
    for (int i = 0; i < L::kWidth && begin + i < candidates.size; ++i) {
      if ((valid >> i & 1) == 0) continue;
      models.sample[models.size] = candidates.lane[begin + i];
      for (int k = 0; k < 9; ++k) models.matrices[models.size][k] = matrices[k][i];
      ++models.size;
    }
  }
}

template <class L, bool kOriented>
void FivePoint(const FivePointSamples& samples, FivePointModels& models) {
  FivePointWork work;
  for (int begin = 0; begin < kFivePointBatch; begin += L::kWidth) {
    MakePolynomial<L>(samples, begin, work);
    MakeChain<L>(begin, work);
  }
  LaneRoots roots;
  FindRoots<L>(work, roots);
  RootItems items;
  for (int lane = 0; lane < kFivePointBatch; ++lane) {
    for (int k = 0; k < roots.count[lane]; ++k) {
      items.lane[items.size] = lane;
      items.z[items.size++] = roots.z[lane][k];
    }
  }
  for (int k = items.size; k < items.size + L::kWidth; ++k) {
    items.lane[k] = 0;
    items.z[k] = 0;
  }
  Candidates candidates;
  MakeCandidates<L, kOriented>(samples, work, items, candidates);
  models.size = 0;
  Finish<L>(work, candidates, models);
}

}  // namespace rilievo::kernels
