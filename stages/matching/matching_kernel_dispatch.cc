// The table of kernels and the choice of one for this processor.
#include <array>
#include <string>

#include "base/error.h"
#include "stages/matching/matching_kernels.h"

namespace rilievo::matching {

std::span<const Kernel> AllKernels() {
  static const std::array<Kernel, 3> kernels = {
      Kernel{.name = "scalar"},
      Kernel{.name = "avx2",
             .encoding = Encoding::kSignedShorts,
             .lanes = 8,
             .vectors = 2,
             .sweep = SweepAvx2,
             .is_supported = __builtin_cpu_supports("avx2") != 0},
      Kernel{.name = "avx512",
             .encoding = Encoding::kBytes,
             .lanes = 16,
             .vectors = 4,
             .sweep = SweepAvx512,
             .is_supported = __builtin_cpu_supports("avx512f") != 0 && __builtin_cpu_supports("avx512bw") != 0 &&
                             __builtin_cpu_supports("avx512dq") != 0 && __builtin_cpu_supports("avx512vl") != 0 &&
                             __builtin_cpu_supports("avx512vnni") != 0}};
  return kernels;
}

const Kernel& ChooseKernel(std::string_view name) {
  const auto kernels = AllKernels();
  if (name.empty()) {
    for (std::size_t i = kernels.size(); i-- > 1;) {
      if (kernels[i].is_supported) return kernels[i];
    }
    return kernels.front();
  }
  for (const Kernel& kernel : kernels) {
    if (kernel.name != name) continue;
    if (kernel.is_supported) return kernel;
    throw Error(ErrorCode::kUsage, "RILIEVO_KERNELS", "this processor has no " + std::string(name),
                "unset it or use scalar");
  }
  throw Error(ErrorCode::kUsage, "RILIEVO_KERNELS", "'" + std::string(name) + "' is not a kernel",
              "use scalar, avx2 or avx512, or unset it");
}

}  // namespace rilievo::matching
