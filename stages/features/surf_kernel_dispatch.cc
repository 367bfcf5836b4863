// The table of SURF's kernels and the choice of one for this processor.
#include <array>
#include <string>

#include "base/cpu.h"
#include "base/error.h"
#include "stages/features/surf_kernels.h"

namespace rilievo::features {

std::span<const SurfKernels> AllSurfKernels() {
  static const std::array<SurfKernels, 3> all = [] {
    std::array<SurfKernels, 3> tables = {kSurfScalar, kSurfAvx2, kSurfAvx512};
    const std::string_view level = ProcessorLevel();
    tables[1].is_supported = level != "base";
    // The files are compiled for these four extensions and VNNI, which the compiler may use where it likes.
    tables[2].is_supported = level == "avx512" && __builtin_cpu_supports("avx512dq") != 0 &&
                             __builtin_cpu_supports("avx512vl") != 0 && __builtin_cpu_supports("avx512vnni") != 0;
    return tables;
  }();
  return all;
}

const SurfKernels& ChooseSurfKernels(std::string_view name) {
  const auto all = AllSurfKernels();
  for (std::size_t i = all.size(); i-- > 0;) {
    const SurfKernels& kernels = all[i];
    if (name.empty() ? kernels.is_supported : kernels.name == name) {
      if (kernels.is_supported) return kernels;
      throw Error(ErrorCode::kUsage, "RILIEVO_KERNELS", "this processor has no " + std::string(name),
                  "unset it or use scalar");
    }
  }
  throw Error(ErrorCode::kUsage, "RILIEVO_KERNELS", "'" + std::string(name) + "' is not a kernel",
              "use scalar, avx2 or avx512, or unset it");
}

}  // namespace rilievo::features
