// The kernels of FAST: avx2.
#include "base/lanes_avx2.h"
#include "stages/features/fast_kernels_impl.h"

namespace rilievo::features {

const FastKernels kFastAvx2 = MakeFastKernels<lanes::Avx2>("avx2");

}  // namespace rilievo::features
