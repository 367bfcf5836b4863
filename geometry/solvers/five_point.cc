// The five-point solver for a single sample, and the scalar roots that its kernels fall back on.
#include "geometry/solvers/five_point.h"

#include "geometry/kernels/five_point_roots_impl.h"
#include "geometry/solvers/real_roots.h"

namespace rilievo {

int kernels::RootsOfDegreeTen(const double (&polynomial)[11], double (&roots)[10]) {
  std::array<double, 11> p;
  for (std::size_t k = 0; k < 11; ++k) p[k] = polynomial[k];
  int count = 0;
  for (const double root : RealRoots<10>(p)) roots[count++] = root;
  return count;
}

EssentialList SolveFivePoint(const std::array<Eigen::Vector2d, 5>& first, const std::array<Eigen::Vector2d, 5>& second,
                             const TwoViewKernels& kernels) {
  FivePointSamples samples;
  for (std::size_t i = 0; i < 5; ++i) {
    for (int lane = 0; lane < kFivePointBatch; ++lane) {
      samples.rows[i][lane] = first[i].x();
      samples.rows[5 + i][lane] = first[i].y();
      samples.rows[10 + i][lane] = second[i].x();
      samples.rows[15 + i][lane] = second[i].y();
    }
  }
  FivePointModels models;
  kernels.five_point(samples, models);
  EssentialList solutions;
  for (int i = 0; i < models.size && models.sample[i] == 0; ++i) {
    solutions.Add(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(models.matrices[i]));
  }
  return solutions;
}

}  // namespace rilievo
