// Elementary functions that give the same bits on every machine: polynomials in double, no library, no contraction.
#pragma once

#include <cmath>
#include <numbers>

namespace rilievo::features {

/// e^x for |x| <= 700, relative error below 1e-15: x = n ln 2 + r, |r| <= ln 2 / 2, Taylor to the 13th power.
inline double Exp(double x) {
  const double n = std::nearbyint(x / std::numbers::ln2);
  const double r = (x - n * 0x1.62e42fee00000p-1) - n * 0x1.a39ef35793c76p-33;  // ln 2 in two parts
  double sum = 1;
  for (int k = 13; k >= 1; --k) sum = 1 + sum * r / k;
  return std::ldexp(sum, static_cast<int>(n));
}

inline double Exp2(double x) { return Exp(x * std::numbers::ln2); }

struct SinCosValue {
  double sin = 0, cos = 1;
};

/// |angle_rad| <= 100, absolute error below 1e-14: reduced to a quarter turn, Taylor to the 17th power.
inline SinCosValue SinCos(double angle_rad) {
  const double quarter = std::numbers::pi / 2, n = std::nearbyint(angle_rad / quarter), r = angle_rad - n * quarter;
  double s = 1, c = 1;
  for (int k = 16; k >= 2; k -= 2) {
    s = 1 - s * r * r / (k * (k + 1));
    c = 1 - c * r * r / (k * (k - 1));
  }
  s *= r;
  switch (static_cast<int>(n) & 3) {
    case 0:
      return {s, c};
    case 1:
      return {c, -s};
    case 2:
      return {-s, -c};
    default:
      return {-c, s};
  }
}

}  // namespace rilievo::features
