// The kernels of two-view geometry: avx2.
#include "base/double_lanes_avx2.h"
#include "base/lanes_avx2.h"
#include "geometry/kernels/five_point_impl.h"
#include "geometry/kernels/residual_impl.h"
#include "geometry/kernels/sums_impl.h"

namespace rilievo {

const TwoViewKernels kTwoViewAvx2 = {
    .name = "avx2",
    .five_point = kernels::FivePoint<lanes::Avx2x64, false>,
    .five_point_oriented = kernels::FivePoint<lanes::Avx2x64, true>,
    .sampson = kernels::Epipolar<lanes::Avx2, false>,
    .both_distances = kernels::Epipolar<lanes::Avx2, true>,
    .transfer = kernels::Transfer<lanes::Avx2>,
    .truncate = kernels::Truncate<lanes::Avx2>,
    .sampson_sums = kernels::AddSampson<lanes::Avx2x64>,
    .transfer_sums = kernels::AddTransfer<lanes::Avx2x64>,
};

}  // namespace rilievo
