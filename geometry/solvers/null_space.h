// Orthonormal null space of a few equations in nine unknowns.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace rilievo {

/// Orthonormal basis of the vectors that `kRows` given vectors of length 9 are all perpendicular to, by Householder
/// reflections (Golub & Van Loan 5.2). Linearly dependent rows leave part of the null space out.
template <int kRows>
std::array<std::array<double, 9>, 9 - kRows> NullSpace9(std::array<std::array<double, 9>, kRows> rows) {
  std::array<double, kRows> beta{};
  for (int i = 0; i < kRows; ++i) {  // reflect row i onto its axis i; the reflection vector replaces the row
    double norm2 = 0;
    for (int k = i; k < 9; ++k) norm2 += rows[i][k] * rows[i][k];
    const double alpha = rows[i][i] > 0 ? -std::sqrt(norm2) : std::sqrt(norm2);
    const double divisor = norm2 - alpha * rows[i][i];
    beta[i] = divisor > 0 ? 1 / divisor : 0;
    rows[i][i] -= alpha;
    for (int k = 0; k < i; ++k) rows[i][k] = 0;
    for (int j = i + 1; j < kRows; ++j) {
      double dot = 0;
      for (int k = i; k < 9; ++k) dot += rows[i][k] * rows[j][k];
      for (int k = i; k < 9; ++k) rows[j][k] -= dot * beta[i] * rows[i][k];
    }
  }
  std::array<std::array<double, 9>, 9 - kRows> basis{};
  for (int b = 0; b < 9 - kRows; ++b) {
    basis[b][kRows + b] = 1;
    for (int i = kRows - 1; i >= 0; --i) {
      double dot = 0;
      for (int k = i; k < 9; ++k) dot += rows[i][k] * basis[b][k];
      for (int k = i; k < 9; ++k) basis[b][k] -= dot * beta[i] * rows[i][k];
    }
  }
  return basis;
}

}  // namespace rilievo
