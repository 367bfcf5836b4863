// Which of several tables of kernels runs: by name, or the widest that this processor supports.
#pragma once

#include <array>
#include <cstdlib>
#include <span>
#include <string>
#include <string_view>

#include "base/cpu.h"
#include "base/error.h"

namespace rilievo {

/// Whether this processor runs what is compiled for scalar, avx2 and avx512 files. The last are built for VNNI, too,
/// which the compiler may use where it likes.
inline std::array<bool, 3> SupportedLevels() {
  const std::string_view level = ProcessorLevel();
  bool has_avx512 = level == "avx512";
#if defined(__x86_64__)
  has_avx512 = has_avx512 && __builtin_cpu_supports("avx512dq") != 0 && __builtin_cpu_supports("avx512vl") != 0 &&
               __builtin_cpu_supports("avx512vnni") != 0;
#endif
  return {true, level != "base", has_avx512};
}

/// `all` in ascending order of width, each with a name and is_supported. An empty name takes the widest supported one.
/// Throws Error(kUsage) for an unknown name or one that this processor lacks.
template <class Kernels>
const Kernels& ChooseKernels(std::span<const Kernels> all, std::string_view name) {
  for (std::size_t i = all.size(); i-- > 0;) {
    const Kernels& kernels = all[i];
    if (name.empty() ? !kernels.is_supported : kernels.name != name) continue;
    if (kernels.is_supported) return kernels;
    throw Error(ErrorCode::kUsage, "RILIEVO_KERNELS", "this processor has no " + std::string(name),
                "unset it or use scalar");
  }
  throw Error(ErrorCode::kUsage, "RILIEVO_KERNELS", "'" + std::string(name) + "' is not a kernel",
              "use scalar, avx2 or avx512, or unset it");
}

/// RILIEVO_KERNELS, or empty.
inline std::string_view ForcedKernels() {
  const char* forced = std::getenv("RILIEVO_KERNELS");
  return forced == nullptr ? "" : forced;
}

}  // namespace rilievo
