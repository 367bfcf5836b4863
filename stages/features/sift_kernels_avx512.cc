// The kernels of SIFT: avx512.
#include "base/lanes_avx512.h"
#include "stages/features/sift_kernels_impl.h"

namespace rilievo::features {

const SiftKernels kSiftAvx512 = MakeSiftKernels<lanes::Avx512>("avx512");

}  // namespace rilievo::features
