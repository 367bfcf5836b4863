// The kernels of two-view geometry: scalar.
#include "base/double_lanes_scalar.h"
#include "base/lanes_scalar.h"
#include "geometry/kernels/five_point_impl.h"
#include "geometry/kernels/residual_impl.h"
#include "geometry/kernels/sums_impl.h"

namespace rilievo {

const TwoViewKernels kTwoViewScalar = {
    .name = "scalar",
    .five_point = kernels::FivePoint<lanes::Scalar64, false>,
    .five_point_oriented = kernels::FivePoint<lanes::Scalar64, true>,
    .sampson = kernels::Epipolar<lanes::Scalar, false>,
    .both_distances = kernels::Epipolar<lanes::Scalar, true>,
    .transfer = kernels::Transfer<lanes::Scalar>,
    .truncate = kernels::Truncate<lanes::Scalar>,
    .sampson_sums = kernels::AddSampson<lanes::Scalar64>,
    .transfer_sums = kernels::AddTransfer<lanes::Scalar64>,
};

}  // namespace rilievo
