// The kernels of SURF: scalar.
#include "base/lanes_scalar.h"
#include "stages/features/surf_kernels_impl.h"

namespace rilievo::features {

const SurfKernels kSurfScalar = MakeSurfKernels<lanes::Scalar>("scalar");

}  // namespace rilievo::features
