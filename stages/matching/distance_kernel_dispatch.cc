// Which kernel of distances goes with which sweep.
#include "base/check.h"
#include "stages/matching/distance_kernels.h"

namespace rilievo::matching {

DistanceKernel DistanceKernelOf(std::string_view name) {
  if (name == "avx512") return DistancesAvx512;
  if (name == "avx2") return DistancesAvx2;
  RILIEVO_CHECK(name == "scalar");
  return DistancesScalar;
}

}  // namespace rilievo::matching
