// The tables of SIFT's kernels and the choice of one for this processor.
#include "stages/features/kernel_choice.h"
#include "stages/features/sift_kernels.h"

namespace rilievo::features {

std::span<const SiftKernels> AllSiftKernels() {
  static const std::array<SiftKernels, 3> all = [] {
    std::array<SiftKernels, 3> kernels = {kSiftScalar, kSiftAvx2, kSiftAvx512};
    const auto supported = SupportedLevels();
    for (std::size_t i = 0; i < kernels.size(); ++i) kernels[i].is_supported = supported[i];
    return kernels;
  }();
  return all;
}

const SiftKernels& ChooseSiftKernels(std::string_view name) { return ChooseKernels(AllSiftKernels(), name); }

}  // namespace rilievo::features
