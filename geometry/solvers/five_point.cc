// The five-point solver: null space, ten cubic constraints, elimination, a polynomial of degree ten in z.
#include "geometry/solvers/five_point.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <utility>

#include "geometry/solvers/null_space.h"
#include "geometry/solvers/real_roots.h"

namespace rilievo {
namespace {

using Linear = std::array<double, 4>;      // x, y, z, 1
using Quadratic = std::array<double, 10>;  // x2 xy xz x y2 yz y z2 z 1
// Nistér's order: x3 y3 x2y xy2 x2z x2 y2z y2 xyz xy | xz2 xz x yz2 yz y z3 z2 z 1
using Cubic = std::array<double, 20>;
using Constraints = std::array<Cubic, 10>;

Quadratic Product(const Linear& a, const Linear& b) {
  return {a[0] * b[0],
          a[0] * b[1] + a[1] * b[0],
          a[0] * b[2] + a[2] * b[0],
          a[0] * b[3] + a[3] * b[0],
          a[1] * b[1],
          a[1] * b[2] + a[2] * b[1],
          a[1] * b[3] + a[3] * b[1],
          a[2] * b[2],
          a[2] * b[3] + a[3] * b[2],
          a[3] * b[3]};
}

Quadratic& operator+=(Quadratic& a, const Quadratic& b) {
  for (std::size_t i = 0; i < 10; ++i) a[i] += b[i];
  return a;
}

Quadratic operator-(const Quadratic& a, const Quadratic& b) {
  Quadratic difference;
  for (std::size_t i = 0; i < 10; ++i) difference[i] = a[i] - b[i];
  return difference;
}

void AddProduct(const Quadratic& q, const Linear& l, Cubic& c) {
  c[0] += q[0] * l[0];
  c[1] += q[4] * l[1];
  c[2] += q[0] * l[1] + q[1] * l[0];
  c[3] += q[1] * l[1] + q[4] * l[0];
  c[4] += q[0] * l[2] + q[2] * l[0];
  c[5] += q[0] * l[3] + q[3] * l[0];
  c[6] += q[4] * l[2] + q[5] * l[1];
  c[7] += q[4] * l[3] + q[6] * l[1];
  c[8] += q[1] * l[2] + q[2] * l[1] + q[5] * l[0];
  c[9] += q[1] * l[3] + q[3] * l[1] + q[6] * l[0];
  c[10] += q[2] * l[2] + q[7] * l[0];
  c[11] += q[2] * l[3] + q[3] * l[2] + q[8] * l[0];
  c[12] += q[3] * l[3] + q[9] * l[0];
  c[13] += q[5] * l[2] + q[7] * l[1];
  c[14] += q[5] * l[3] + q[6] * l[2] + q[8] * l[1];
  c[15] += q[6] * l[3] + q[9] * l[1];
  c[16] += q[7] * l[2];
  c[17] += q[7] * l[3] + q[8] * l[2];
  c[18] += q[8] * l[3] + q[9] * l[2];
  c[19] += q[9] * l[3];
}

/// E = x X + y Y + z Z + W, entry k (row-major) as a linear polynomial; (E E' - tr(E E') / 2) E = 0 and det E = 0.
Constraints MakeConstraints(const std::array<Linear, 9>& e) {
  std::array<Quadratic, 6> eet;  // 00 01 02 11 12 22
  int entry = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      eet[entry] = Product(e[3 * i], e[3 * j]);
      eet[entry] += Product(e[3 * i + 1], e[3 * j + 1]);
      eet[entry++] += Product(e[3 * i + 2], e[3 * j + 2]);
    }
  }
  for (std::size_t k = 0; k < 10; ++k) {
    const double half_trace = 0.5 * (eet[0][k] + eet[3][k] + eet[5][k]);
    eet[0][k] -= half_trace;
    eet[3][k] -= half_trace;
    eet[5][k] -= half_trace;
  }
  constexpr int kSymmetric[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
  Constraints constraints{};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      for (int k = 0; k < 3; ++k) AddProduct(eet[kSymmetric[i][k]], e[3 * k + j], constraints[3 * i + j]);
    }
  }
  AddProduct(Product(e[4], e[8]) - Product(e[5], e[7]), e[0], constraints[9]);
  AddProduct(Product(e[5], e[6]) - Product(e[3], e[8]), e[1], constraints[9]);
  AddProduct(Product(e[3], e[7]) - Product(e[4], e[6]), e[2], constraints[9]);
  return constraints;
}

/// Gauss-Jordan on the first ten columns, partial pivoting; only the six rows of x2z x2 y2z y2 xyz xy are made
/// complete. False when a pivot vanishes.
bool Eliminate(Constraints& m) {
  for (int column = 0; column < 10; ++column) {
    int pivot = column;
    for (int row = column + 1; row < 10; ++row) {
      if (std::abs(m[row][column]) > std::abs(m[pivot][column])) pivot = row;
    }
    if (!(std::abs(m[pivot][column]) > 1e-30)) return false;
    std::swap(m[pivot], m[column]);
    const double inverse = 1 / m[column][column];
    for (int k = column & ~1; k < 20; ++k) m[column][k] *= inverse;
    for (int row = column < 4 ? column + 1 : 4; row < 10; ++row) {
      if (row == column) continue;
      const double factor = m[row][column];
      for (int k = column & ~1; k < 20; ++k) m[row][k] -= factor * m[column][k];
    }
  }
  return true;
}

/// Row "upper" (leading term q z) minus z times row "lower" (leading term q): polynomials in z, by rising power, that
/// multiply x (degree 3), y (degree 3) and 1 (degree 4).
struct RowOfB {
  std::array<double, 4> x, y;
  std::array<double, 5> one;
};

RowOfB MakeRow(const Cubic& upper, const Cubic& lower) {
  return {{upper[12], upper[11] - lower[12], upper[10] - lower[11], -lower[10]},
          {upper[15], upper[14] - lower[15], upper[13] - lower[14], -lower[13]},
          {upper[19], upper[18] - lower[19], upper[17] - lower[18], upper[16] - lower[17], -lower[16]}};
}

template <std::size_t kA, std::size_t kB>
std::array<double, kA + kB - 1> Multiply(const std::array<double, kA>& a, const std::array<double, kB>& b) {
  std::array<double, kA + kB - 1> product{};
  for (std::size_t i = 0; i < kA; ++i) {
    for (std::size_t j = 0; j < kB; ++j) product[i + j] += a[i] * b[j];
  }
  return product;
}

template <std::size_t kSize>
std::array<double, kSize> Difference(std::array<double, kSize> a, const std::array<double, kSize>& b) {
  for (std::size_t i = 0; i < kSize; ++i) a[i] -= b[i];
  return a;
}

std::array<double, 11> Determinant(const std::array<RowOfB, 3>& b) {
  std::array<double, 11> det{};
  for (int i = 0; i < 3; ++i) {
    const RowOfB &p = b[(i + 1) % 3], &q = b[(i + 2) % 3];
    const auto term = Multiply(b[i].one, Difference(Multiply(p.x, q.y), Multiply(p.y, q.x)));
    for (std::size_t k = 0; k < 11; ++k) det[k] += term[k];
  }
  return det;
}

template <std::size_t kSize>
double Evaluate(const std::array<double, kSize>& p, double z) {
  double value = p[kSize - 1];
  for (std::size_t k = kSize - 1; k-- > 0;) value = value * z + p[k];
  return value;
}

/// (x, y, z) of a root z: the null vector of B(z), from the two rows that determine it best.
Eigen::Vector3d BackSubstitute(const std::array<RowOfB, 3>& b, double z) {
  std::array<Eigen::Vector3d, 3> rows;
  for (int i = 0; i < 3; ++i) rows[i] = {Evaluate(b[i].x, z), Evaluate(b[i].y, z), Evaluate(b[i].one, z)};
  Eigen::Vector3d best = rows[0].cross(rows[1]);
  for (const Eigen::Vector3d& candidate :
       {Eigen::Vector3d(rows[1].cross(rows[2])), Eigen::Vector3d(rows[2].cross(rows[0]))}) {
    if (candidate.squaredNorm() > best.squaredNorm()) best = candidate;
  }
  return {best[0] / best[2], best[1] / best[2], z};
}

/// Gauss-Newton on the ten constraints: takes back what elimination and the determinant lost in digits.
Eigen::Vector3d Polish(const Constraints& constraints, Eigen::Vector3d v) {
  constexpr int kSteps = 10;
  for (int step = 0; step < kSteps; ++step) {
    const double x = v[0], y = v[1], z = v[2];
    const Cubic m{x * x * x, y * y * y, x * x * y, x * y * y, x * x * z, x * x, y * y * z, y * y, x * y * z, x * y,
                  x * z * z, x * z,     x,         y * z * z, y * z,     y,     z * z * z, z * z, z,         1};
    const Cubic dx{3 * x * x, 0, 2 * x * y, y * y, 2 * x * z, 2 * x, 0, 0, y * z, y, z * z, z, 1, 0, 0, 0, 0, 0, 0, 0};
    const Cubic dy{0, 3 * y * y, x * x, 2 * x * y, 0, 0, 2 * y * z, 2 * y, x * z, x, 0, 0, 0, z * z, z, 1, 0, 0, 0, 0};
    const Cubic dz{0, 0, 0, 0, x * x, 0, y * y, 0, x * y, 0, 2 * x * z, x, 0, 2 * y * z, y, 0, 3 * z * z, 2 * z, 1, 0};
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const Cubic& c : constraints) {
      double r = 0, jx = 0, jy = 0, jz = 0;
      for (std::size_t k = 0; k < 20; ++k) {
        r += c[k] * m[k];
        jx += c[k] * dx[k];
        jy += c[k] * dy[k];
        jz += c[k] * dz[k];
      }
      const Eigen::Vector3d j(jx, jy, jz);
      normal += j * j.transpose();
      right += j * r;
    }
    const Eigen::Vector3d change = normal.inverse() * right;
    if (!change.allFinite() || change.squaredNorm() > 0.04 * (1 + v.squaredNorm())) return v;
    v -= change;
    if (change.squaredNorm() < 1e-16 * (1 + v.squaredNorm())) return v;
  }
  return v;
}

}  // namespace

EssentialList SolveFivePoint(const std::array<Eigen::Vector3d, 5>& first,
                             const std::array<Eigen::Vector3d, 5>& second) {
  std::array<std::array<double, 9>, 5> rows;
  for (std::size_t i = 0; i < 5; ++i) {
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) rows[i][3 * r + c] = second[i][r] * first[i][c];
    }
  }
  const auto basis = NullSpace9<5>(rows);
  std::array<Linear, 9> e;
  for (std::size_t k = 0; k < 9; ++k) e[k] = {basis[0][k], basis[1][k], basis[2][k], basis[3][k]};

  EssentialList solutions;
  const Constraints constraints = MakeConstraints(e);
  Constraints reduced = constraints;
  if (!Eliminate(reduced)) return solutions;
  const std::array<RowOfB, 3> b{MakeRow(reduced[4], reduced[5]), MakeRow(reduced[6], reduced[7]),
                                MakeRow(reduced[8], reduced[9])};
  for (const double z : RealRoots<10>(Determinant(b))) {
    const Eigen::Vector3d v = Polish(constraints, BackSubstitute(b, z));
    Eigen::Matrix3d essential;
    for (std::size_t k = 0; k < 9; ++k) {
      essential(static_cast<int>(k) / 3, static_cast<int>(k) % 3) =
          v[0] * e[k][0] + v[1] * e[k][1] + v[2] * e[k][2] + e[k][3];
    }
    essential /= essential.norm();
    // Guards against a spurious root; written so that NaN fails too.
    const Eigen::Matrix3d eet = essential * essential.transpose();
    if ((2 * eet * essential - eet.trace() * essential).squaredNorm() < 1e-20) solutions.Add(essential);
  }
  return solutions;
}

}  // namespace rilievo
