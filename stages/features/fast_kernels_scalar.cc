// The kernels of FAST: scalar.
#include "base/lanes_scalar.h"
#include "stages/features/fast_kernels_impl.h"

namespace rilievo::features {

const FastKernels kFastScalar = MakeFastKernels<lanes::Scalar>("scalar");

}  // namespace rilievo::features
