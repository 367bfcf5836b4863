// The processor level that kernels and libraries dispatch on.
#pragma once

#include <string_view>

namespace rilievo {

/// "avx512", "avx2" or "base". Part of the keys of results that pass through a BLAS, whose kernels differ by level.
inline std::string_view ProcessorLevel() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw")) return "avx512";
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return "avx2";
#endif
  return "base";
}

}  // namespace rilievo
