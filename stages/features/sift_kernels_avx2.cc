// The kernels of SIFT: avx2.
#include "base/lanes_avx2.h"
#include "stages/features/sift_kernels_impl.h"

namespace rilievo::features {

const SiftKernels kSiftAvx2 = MakeSiftKernels<lanes::Avx2>("avx2");

}  // namespace rilievo::features
