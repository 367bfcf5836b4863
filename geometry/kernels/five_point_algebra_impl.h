// Linear algebra of the five-point solver over lanes: null space, constraints, elimination, polynomial, polishing.
#pragma once

#include "geometry/kernels/two_view_kernels.h"

namespace rilievo::kernels {

/// What the samples leave behind for their roots, a lane a sample.
struct FivePointWork {
  alignas(64) double basis[36][kFivePointBatch];       ///< X, Y, Z, W of E = x X + y Y + z Z + W, orthonormal
  alignas(64) double rows[39][kFivePointBatch];        ///< B(z): of three rows the factors of x (4), y (4), 1 (5)
  alignas(64) double polynomial[11][kFivePointBatch];  ///< det B(z) by rising power
  alignas(64) double slope[10][kFivePointBatch], offset[10][kFivePointBatch], scale[10][kFivePointBatch];
  alignas(64) double last[kFivePointBatch];     ///< Sturm's chain (five_point_roots_impl.h)
  alignas(64) double regular[kFivePointBatch];  ///< 1 where the chain is complete, else 0
};

/// Orthonormal null space of five rows, by Householder reflections (as NullSpace9). basis[9 b + k].
template <class L>
void NullSpace(typename L::D (&rows)[5][9], typename L::D (&basis)[36]) {
  using D = typename L::D;
  const D zero = L::Set(0.0), one = L::Set(1.0);
  D beta[5];
  for (int i = 0; i < 5; ++i) {
    D norm2 = zero;
    for (int k = i; k < 9; ++k) norm2 = norm2 + rows[i][k] * rows[i][k];
    const D root = L::Sqrt(norm2);
    const D alpha = L::Select(L::Less(zero, rows[i][i]), zero - root, root);
    const D divisor = norm2 - alpha * rows[i][i];
    const auto regular = L::Less(zero, divisor);
    beta[i] = L::Select(regular, one / L::Select(regular, divisor, one), zero);
    rows[i][i] = rows[i][i] - alpha;
    for (int j = i + 1; j < 5; ++j) {
      D dot = zero;
      for (int k = i; k < 9; ++k) dot = dot + rows[i][k] * rows[j][k];
      dot = dot * beta[i];
      for (int k = i; k < 9; ++k) rows[j][k] = rows[j][k] - dot * rows[i][k];
    }
  }
  for (int b = 0; b < 4; ++b) {
    D* v = basis + 9 * b;
    for (int k = 0; k < 9; ++k) v[k] = k == 5 + b ? one : zero;
    for (int i = 4; i >= 0; --i) {
      D dot = zero;
      for (int k = i; k < 9; ++k) dot = dot + rows[i][k] * v[k];
      dot = dot * beta[i];
      for (int k = i; k < 9; ++k) v[k] = v[k] - dot * rows[i][k];
    }
  }
}

/// Product of two linear polynomials in x, y, z, 1: x2 xy xz x y2 yz y z2 z 1, added to q with a sign.
template <class L, bool kMinus = false>
void AddSquare(const typename L::D (&a)[4], const typename L::D (&b)[4], typename L::D (&q)[10]) {
  const typename L::D p[10] = {a[0] * b[0],
                               a[0] * b[1] + a[1] * b[0],
                               a[0] * b[2] + a[2] * b[0],
                               a[0] * b[3] + a[3] * b[0],
                               a[1] * b[1],
                               a[1] * b[2] + a[2] * b[1],
                               a[1] * b[3] + a[3] * b[1],
                               a[2] * b[2],
                               a[2] * b[3] + a[3] * b[2],
                               a[3] * b[3]};
  for (int k = 0; k < 10; ++k) q[k] = kMinus ? q[k] - p[k] : q[k] + p[k];
}

/// q l added to c. Nistér's order: x3 y3 x2y xy2 x2z x2 y2z y2 xyz xy | xz2 xz x yz2 yz y z3 z2 z 1.
template <class L>
void AddCube(const typename L::D (&q)[10], const typename L::D (&l)[4], typename L::D (&c)[20]) {
  c[0] = c[0] + q[0] * l[0];
  c[1] = c[1] + q[4] * l[1];
  c[2] = c[2] + (q[0] * l[1] + q[1] * l[0]);
  c[3] = c[3] + (q[1] * l[1] + q[4] * l[0]);
  c[4] = c[4] + (q[0] * l[2] + q[2] * l[0]);
  c[5] = c[5] + (q[0] * l[3] + q[3] * l[0]);
  c[6] = c[6] + (q[4] * l[2] + q[5] * l[1]);
  c[7] = c[7] + (q[4] * l[3] + q[6] * l[1]);
  c[8] = c[8] + (q[1] * l[2] + q[2] * l[1] + q[5] * l[0]);
  c[9] = c[9] + (q[1] * l[3] + q[3] * l[1] + q[6] * l[0]);
  c[10] = c[10] + (q[2] * l[2] + q[7] * l[0]);
  c[11] = c[11] + (q[2] * l[3] + q[3] * l[2] + q[8] * l[0]);
  c[12] = c[12] + (q[3] * l[3] + q[9] * l[0]);
  c[13] = c[13] + (q[5] * l[2] + q[7] * l[1]);
  c[14] = c[14] + (q[5] * l[3] + q[6] * l[2] + q[8] * l[1]);
  c[15] = c[15] + (q[6] * l[3] + q[9] * l[1]);
  c[16] = c[16] + q[7] * l[2];
  c[17] = c[17] + (q[7] * l[3] + q[8] * l[2]);
  c[18] = c[18] + (q[8] * l[3] + q[9] * l[2]);
  c[19] = c[19] + q[9] * l[3];
}

/// (E E' - tr(E E') / 2) E = 0 and det E = 0; entry k (row-major) of E as the linear polynomial e[k].
template <class L>
void MakeConstraints(const typename L::D (&e)[9][4], typename L::D (&m)[10][20]) {
  using D = typename L::D;
  constexpr int kSymmetric[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
  const D zero = L::Set(0.0), half = L::Set(0.5);
  D eet[6][10];
  for (auto& q : eet) {
    for (D& value : q) value = zero;
  }
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      for (int k = 0; k < 3; ++k) AddSquare<L>(e[3 * i + k], e[3 * j + k], eet[kSymmetric[i][j]]);
    }
  }
  for (int k = 0; k < 10; ++k) {
    const D half_trace = half * (eet[0][k] + eet[3][k] + eet[5][k]);
    eet[0][k] = eet[0][k] - half_trace;
    eet[3][k] = eet[3][k] - half_trace;
    eet[5][k] = eet[5][k] - half_trace;
  }
  for (int row = 0; row < 10; ++row) {
    for (int k = 0; k < 20; ++k) m[row][k] = zero;
  }
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      for (int k = 0; k < 3; ++k) AddCube<L>(eet[kSymmetric[i][k]], e[3 * k + j], m[3 * i + j]);
    }
  }
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    D minor[10];
    for (D& value : minor) value = zero;
    AddSquare<L>(e[3 + j], e[6 + k], minor);
    AddSquare<L, true>(e[3 + k], e[6 + j], minor);
    AddCube<L>(minor, e[i], m[9]);
  }
}

/// Makes the first ten columns upper triangular by Householder reflections, which need no pivots, and rows 4 to 9 (x2z
/// x2 y2z y2 xyz xy) the identity there. A singular system ends in values that are not finite.
template <class L>
void Eliminate(typename L::D (&m)[10][20]) {
  using D = typename L::D;
  const D zero = L::Set(0.0), one = L::Set(1.0);
  for (int c = 0; c < 9; ++c) {
    D norm2 = zero;
    for (int r = c; r < 10; ++r) norm2 = norm2 + m[r][c] * m[r][c];
    const D root = L::Sqrt(norm2);
    const D alpha = L::Select(L::Less(zero, m[c][c]), zero - root, root);
    const D first = m[c][c] - alpha, beta = one / (norm2 - alpha * m[c][c]);
    for (int k = c + 1; k < 20; ++k) {
      D dot = first * m[c][k];
      for (int r = c + 1; r < 10; ++r) dot = dot + m[r][c] * m[r][k];
      dot = dot * beta;
      m[c][k] = m[c][k] - dot * first;
      for (int r = c + 1; r < 10; ++r) m[r][k] = m[r][k] - dot * m[r][c];
    }
    m[c][c] = alpha;
  }
  for (int i = 9; i >= 4; --i) {
    const D inverse = one / m[i][i];
    for (int k = 10; k < 20; ++k) {
      D value = m[i][k];
      for (int j = i + 1; j < 10; ++j) value = value - m[i][j] * m[j][k];
      m[i][k] = value * inverse;
    }
  }
}

/// Row "upper" (leading term q z) minus z times row "lower" (leading term q): factors of x (by rising power of z), of y
/// and of 1.
template <class L>
void MakeRow(const typename L::D (&u)[20], const typename L::D (&l)[20], typename L::D (&row)[13]) {
  const typename L::D zero = L::Set(0.0);
  const typename L::D values[13] = {u[12],         u[11] - l[12], u[10] - l[11], zero - l[10], u[15],
                                    u[14] - l[15], u[13] - l[14], zero - l[13],  u[19],        u[18] - l[19],
                                    u[17] - l[18], u[16] - l[17], zero - l[16]};
  for (int k = 0; k < 13; ++k) row[k] = values[k];
}

/// det B(z), expanded by the third column.
template <class L>
void Determinant(const typename L::D (&b)[3][13], typename L::D (&det)[11]) {
  using D = typename L::D;
  for (D& value : det) value = L::Set(0.0);
  for (int i = 0; i < 3; ++i) {
    const D *p = b[(i + 1) % 3], *q = b[(i + 2) % 3];
    D minor[7];
    for (D& value : minor) value = L::Set(0.0);
    for (int j = 0; j < 4; ++j) {
      for (int k = 0; k < 4; ++k) minor[j + k] = minor[j + k] + (p[j] * q[4 + k] - p[4 + j] * q[k]);
    }
    for (int j = 0; j < 5; ++j) {
      for (int k = 0; k < 7; ++k) det[j + k] = det[j + k] + b[i][8 + j] * minor[k];
    }
  }
}

template <class L>
void MakePolynomial(const FivePointSamples& samples, int begin, FivePointWork& work) {
  using D = typename L::D;
  D rows[5][9], basis[36];
  for (int i = 0; i < 5; ++i) {
    const D x1 = L::Load(samples.rows[i] + begin), y1 = L::Load(samples.rows[5 + i] + begin);
    const D x2 = L::Load(samples.rows[10 + i] + begin), y2 = L::Load(samples.rows[15 + i] + begin);
    const D row[9] = {x2 * x1, x2 * y1, x2, y2 * x1, y2 * y1, y2, x1, y1, L::Set(1.0)};
    for (int k = 0; k < 9; ++k) rows[i][k] = row[k];
  }
  NullSpace<L>(rows, basis);
  D e[9][4], m[10][20], b[3][13], det[11];
  for (int k = 0; k < 9; ++k) {
    for (int i = 0; i < 4; ++i) e[k][i] = basis[9 * i + k];
  }
  MakeConstraints<L>(e, m);
  Eliminate<L>(m);
  for (int i = 0; i < 3; ++i) MakeRow<L>(m[4 + 2 * i], m[5 + 2 * i], b[i]);
  Determinant<L>(b, det);
  for (int k = 0; k < 36; ++k) L::Store(work.basis[k] + begin, basis[k]);
  for (int k = 0; k < 39; ++k) L::Store(work.rows[k] + begin, b[k / 13][k % 13]);
  for (int k = 0; k < 11; ++k) L::Store(work.polynomial[k] + begin, det[k]);
}

/// a b' of 3 x 3 matrices (row-major).
template <class L>
void TimesTransposed(const typename L::D (&a)[9], const typename L::D (&b)[9], typename L::D (&product)[9]) {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      product[3 * i + j] = a[3 * i] * b[3 * j] + a[3 * i + 1] * b[3 * j + 1] + a[3 * i + 2] * b[3 * j + 2];
    }
  }
}

template <class L>
void Times(const typename L::D (&a)[9], const typename L::D (&b)[9], typename L::D (&product)[9]) {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j)
      product[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
  }
}

/// A = 2 E E' - tr(E E'), of which A E vanishes for an essential matrix.
template <class L>
void TraceMatrix(const typename L::D (&e)[9], typename L::D (&a)[9]) {
  TimesTransposed<L>(e, e, a);
  const typename L::D trace = a[0] + a[4] + a[8];
  for (int k = 0; k < 9; ++k) a[k] = k % 4 == 0 ? (a[k] + a[k]) - trace : a[k] + a[k];
}

template <class L>
typename L::D ConstraintError(const typename L::D (&e)[9]) {
  using D = typename L::D;
  D a[9], f[9];
  TraceMatrix<L>(e, a);
  Times<L>(a, e, f);
  D sum = f[0] * f[0];
  for (int k = 1; k < 9; ++k) sum = sum + f[k] * f[k];
  return sum;
}

/// Solves the symmetric positive definite system n d = r of four unknowns (lower triangle of n), by L D L'.
template <class L>
void SolveFour(typename L::D (&n)[4][4], typename L::D (&r)[4]) {
  using D = typename L::D;
  D inverse[4];
  for (int j = 0; j < 4; ++j) {
    inverse[j] = L::Set(1.0) / n[j][j];
    for (int i = j + 1; i < 4; ++i) {
      const D factor = n[i][j] * inverse[j];
      for (int k = i; k < 4; ++k) n[k][i] = n[k][i] - factor * n[k][j];
      r[i] = r[i] - factor * r[j];
    }
  }
  for (int i = 3; i >= 0; --i) {
    D value = r[i] * inverse[i];
    for (int j = i + 1; j < 4; ++j) value = value - (n[j][i] * inverse[i]) * r[j];
    r[i] = value;
  }
}

/// One Gauss-Newton step of F(E) = 2 E E'E - tr(E E') E over E = sum of c[i] basis[i], perpendicular to c:
///   dF(B) = A B + 2 B E'E + 2 E B'E - 2 tr(E'B) E, with tr(E'B_i) = c_i since the basis is orthonormal.
template <class L>
void ConstraintStep(const typename L::D (&basis)[36], const typename L::D (&c)[4], const typename L::D (&e)[9],
                    typename L::D (&step)[4]) {
  using D = typename L::D;
  D a[9], f[9], transposed[9], q[9], j[4][9];
  TraceMatrix<L>(e, a);
  Times<L>(a, e, f);
  for (int k = 0; k < 9; ++k) transposed[k] = e[3 * (k % 3) + k / 3];
  TimesTransposed<L>(transposed, transposed, q);
  for (int i = 0; i < 4; ++i) {
    D b[9], eb[9], ab[9], bq[9], ebe[9];
    for (int k = 0; k < 9; ++k) b[k] = basis[9 * i + k];
    TimesTransposed<L>(e, b, eb);
    Times<L>(eb, e, ebe);
    Times<L>(a, b, ab);
    Times<L>(b, q, bq);
    for (int k = 0; k < 9; ++k) {
      const D twice = (bq[k] + ebe[k]) - c[i] * e[k];
      j[i][k] = ab[k] + (twice + twice);
    }
  }
  D n[4][4];
  for (int i = 0; i < 4; ++i) {
    for (int k = 0; k <= i; ++k) {
      n[i][k] = c[i] * c[k];
      for (int l = 0; l < 9; ++l) n[i][k] = n[i][k] + j[i][l] * j[k][l];
    }
    step[i] = L::Set(0.0);
    for (int l = 0; l < 9; ++l) step[i] = step[i] - j[i][l] * f[l];
  }
  SolveFour<L>(n, step);
}

/// Takes back what elimination and the determinant lost in digits. On return e is the matrix of c.
template <class L>
void PolishEssential(const typename L::D (&basis)[36], typename L::D (&c)[4], typename L::D (&e)[9]) {
  using D = typename L::D;
  constexpr int kSteps = 10;
  constexpr std::uint32_t kAll = (1U << L::kWidth) - 1;
  const D zero = L::Set(0.0), one = L::Set(1.0);
  auto combine = [&] {
    for (int k = 0; k < 9; ++k) {
      e[k] = (c[0] * basis[k] + c[1] * basis[9 + k]) + (c[2] * basis[18 + k] + c[3] * basis[27 + k]);
    }
  };
  auto active = L::Less(zero, one);
  combine();
  for (int round = 0; round < kSteps; ++round) {
    D step[4];
    ConstraintStep<L>(basis, c, e, step);
    const D size2 = (step[0] * step[0] + step[1] * step[1]) + (step[2] * step[2] + step[3] * step[3]);
    active = L::And(active, L::Less(size2, L::Set(0.04)));  // a leap would be to another root; NaN ends here, too
    D moved[4];
    for (int k = 0; k < 4; ++k) moved[k] = c[k] + step[k];
    const D norm2 = (moved[0] * moved[0] + moved[1] * moved[1]) + (moved[2] * moved[2] + moved[3] * moved[3]);
    const D inverse = one / L::Sqrt(norm2);
    for (int k = 0; k < 4; ++k) c[k] = L::Select(active, moved[k] * inverse, c[k]);
    combine();
    active = L::And(active, L::Less(L::Set(1e-15), size2));
    if ((L::Bits(active) & kAll) == 0) break;
  }
}

}  // namespace rilievo::kernels
