// The vector vocabulary of the kernels in double precision, one lane wide: the reference that the wide ones equal bit
// by bit (as lanes_scalar.h for floats).
#pragma once

#include <cmath>
#include <cstdint>

namespace rilievo::lanes {

/// D: kWidth doubles with + - * / ; M: a mask of them. Every operation is exactly rounded, and there is no fused
/// multiply-add: emulating one in double would make processors without it slow by orders of magnitude.
struct Scalar64 {
  static constexpr int kWidth = 1;
  using D = double;
  using M = bool;
  using Index = std::int32_t;

  static D Set(double v) { return v; }
  static D Load(const double* p) { return *p; }
  static void Store(double* p, D v) { *p = v; }
  static D Sqrt(D v) { return std::sqrt(v); }
  static D Abs(D v) { return std::fabs(v); }
  static M Less(D a, D b) { return a < b; }
  static M SignsDiffer(D a, D b) { return std::signbit(a) != std::signbit(b); }
  static M And(M a, M b) { return a && b; }
  static M Or(M a, M b) { return a || b; }
  static D Select(M mask, D if_true, D if_false) { return mask ? if_true : if_false; }
  /// One bit a lane where the mask is set.
  static std::uint32_t Bits(M mask) { return mask ? 1U : 0U; }
  /// Of the eight values of a row, the one that each lane's index (0..7) names.
  static Index LoadIndex(const std::int32_t* p) { return *p; }
  static D Pick(const double* row, Index index) { return row[index]; }
};

}  // namespace rilievo::lanes
