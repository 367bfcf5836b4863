// The table of SURF's kernels.
#include "stages/features/kernel_choice.h"
#include "stages/features/surf_kernels.h"

namespace rilievo::features {

std::span<const SurfKernels> AllSurfKernels() {
  static const std::array<SurfKernels, 3> all = [] {
    std::array<SurfKernels, 3> tables = {kSurfScalar, kSurfAvx2, kSurfAvx512};
    for (std::size_t i = 0; i < tables.size(); ++i) tables[i].is_supported = SupportedLevels()[i];
    return tables;
  }();
  return all;
}

const SurfKernels& ChooseSurfKernels(std::string_view name) { return ChooseKernels(AllSurfKernels(), name); }

}  // namespace rilievo::features
