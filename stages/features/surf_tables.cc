// Sample grids and Gaussian weights of SURF's orientation and descriptor.
#include "stages/features/fixed_math.h"
#include "stages/features/surf_kernels.h"

namespace rilievo::features::surf {
namespace {

double Gauss(double u, double v, double sigma) { return Exp(-(u * u + v * v) / (2 * sigma * sigma)); }

Tables Build() {
  Tables tables;
  int n = 0;
  for (int v = -6; v <= 6; ++v) {
    for (int u = -6; u <= 6; ++u) {
      if (u * u + v * v > 36) continue;
      tables.circle_u[n] = static_cast<float>(u);
      tables.circle_v[n] = static_cast<float>(v);
      tables.circle_weight[n++] = static_cast<float>(Gauss(u, v, 2.0));  // section 4.1: 2 s
    }
  }
  for (int cell = 0; cell < kCells; ++cell) {
    for (int i = 0; i < kCellSamples; ++i) {
      // 20 x 20 samples at the centres of squares of side s: +-0.5 s .. +-9.5 s.
      const double u = 5 * (cell % 4) + i % 5 - 9.5, v = 5 * (cell / 4) + i / 5 - 9.5;
      tables.grid_u[i][cell] = static_cast<float>(u);
      tables.grid_v[i][cell] = static_cast<float>(v);
      tables.grid_weight[i][cell] = static_cast<float>(Gauss(u, v, 3.3));  // section 4.2: 3.3 s
    }
  }
  return tables;
}

}  // namespace

const Tables& SurfTables() {
  static const Tables tables = Build();
  return tables;
}

}  // namespace rilievo::features::surf
