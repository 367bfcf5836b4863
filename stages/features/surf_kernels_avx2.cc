// The kernels of SURF: avx2.
#include "base/lanes_avx2.h"
#include "stages/features/surf_kernels_impl.h"

namespace rilievo::features {

const SurfKernels kSurfAvx2 = MakeSurfKernels<lanes::Avx2>("avx2");

}  // namespace rilievo::features
