// The kernels of SURF: avx512.
// g++ 12's own header reads vectors that are undefined by intent (its bug 105593).
#pragma GCC diagnostic ignored "-Wuninitialized"
#include "base/lanes_avx512.h"
#include "stages/features/surf_kernels_impl.h"

namespace rilievo::features {

const SurfKernels kSurfAvx512 = MakeSurfKernels<lanes::Avx512>("avx512");

}  // namespace rilievo::features
