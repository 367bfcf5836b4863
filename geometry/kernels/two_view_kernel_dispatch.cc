// The table of the kernels of two-view geometry.
#include "base/kernel_choice.h"
#include "geometry/kernels/two_view_kernels.h"

namespace rilievo {

std::span<const TwoViewKernels> AllTwoViewKernels() {
  static const std::array<TwoViewKernels, 3> all = [] {
    std::array<TwoViewKernels, 3> tables = {kTwoViewScalar, kTwoViewAvx2, kTwoViewAvx512};
    for (std::size_t i = 0; i < tables.size(); ++i) tables[i].is_supported = SupportedLevels()[i];
    return tables;
  }();
  return all;
}

const TwoViewKernels& ChooseTwoViewKernels(std::string_view name) { return ChooseKernels(AllTwoViewKernels(), name); }

const TwoViewKernels& ActiveTwoViewKernels() {
  static const TwoViewKernels& kernels = ChooseTwoViewKernels(ForcedKernels());
  return kernels;
}

}  // namespace rilievo
