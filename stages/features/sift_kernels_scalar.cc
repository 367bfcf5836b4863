// The kernels of SIFT: scalar.
#include "base/lanes_scalar.h"
#include "stages/features/sift_kernels_impl.h"

namespace rilievo::features {

const SiftKernels kSiftScalar = MakeSiftKernels<lanes::Scalar>("scalar");

}  // namespace rilievo::features
