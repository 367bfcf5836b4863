// The table of FAST's kernels.
#include "stages/features/fast_kernels.h"
#include "stages/features/kernel_choice.h"

namespace rilievo::features {

std::span<const FastKernels> AllFastKernels() {
  static const std::array<FastKernels, 3> all = [] {
    std::array<FastKernels, 3> tables = {kFastScalar, kFastAvx2, kFastAvx512};
    for (std::size_t i = 0; i < tables.size(); ++i) tables[i].is_supported = SupportedLevels()[i];
    return tables;
  }();
  return all;
}

const FastKernels& ChooseFastKernels(std::string_view name) { return ChooseKernels(AllFastKernels(), name); }

}  // namespace rilievo::features
