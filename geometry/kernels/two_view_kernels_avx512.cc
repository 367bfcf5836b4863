// The kernels of two-view geometry: avx512.
// g++ 12's own header reads vectors that are undefined by intent (its bug 105593).
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include "base/double_lanes_avx512.h"
#include "base/lanes_avx512.h"
#include "geometry/kernels/five_point_impl.h"
#include "geometry/kernels/residual_impl.h"
#include "geometry/kernels/sums_impl.h"

namespace rilievo {

const TwoViewKernels kTwoViewAvx512 = {
    .name = "avx512",
    .five_point = kernels::FivePoint<lanes::Avx512x64, false>,
    .five_point_oriented = kernels::FivePoint<lanes::Avx512x64, true>,
    .sampson = kernels::Epipolar<lanes::Avx512, false>,
    .both_distances = kernels::Epipolar<lanes::Avx512, true>,
    .transfer = kernels::Transfer<lanes::Avx512>,
    .truncate = kernels::Truncate<lanes::Avx512>,
    .sampson_sums = kernels::AddSampson<lanes::Avx512x64>,
    .transfer_sums = kernels::AddTransfer<lanes::Avx512x64>,
};

}  // namespace rilievo
