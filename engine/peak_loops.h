// The most that a core does of the instruction at the heart of a kernel, on registers alone.
#pragma once

#if defined(__x86_64__)

namespace rilievo::engine {

struct PeakLoop {
  double products;  ///< multiply-adds that one call makes: of eight bits (AVX2: sixteen), or of floats
  void (*run)();
};

inline constexpr int kPeakRounds = 100'000;

/// 24 independent chains of vpdpbusd: 64 products each.
inline void RunPeakAvx512() {
  asm volatile(
      "mov %0, %%ecx\n"
      "1:\n"
      ".irp reg,0,1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17,18,19,20,21,22,23\n"
      "vpdpbusd %%zmm31, %%zmm30, %%zmm\\reg\n"
      ".endr\n"
      "dec %%ecx\n"
      "jnz 1b\n"
      "vzeroupper\n"
      :
      : "i"(kPeakRounds)
      : "ecx", "cc", "memory", "xmm0", "xmm1", "xmm2", "xmm3", "xmm4", "xmm5", "xmm6", "xmm7", "xmm8", "xmm9", "xmm10",
        "xmm11", "xmm12", "xmm13", "xmm14", "xmm15");
}

/// 12 independent chains of vpmaddwd and vpaddd: 16 products each.
inline void RunPeakAvx2() {
  asm volatile(
      "mov %0, %%ecx\n"
      "1:\n"
      ".irp reg,0,1,2,3,4,5,6,7,8,9,10,11\n"
      "vpmaddwd %%ymm15, %%ymm14, %%ymm13\n"
      "vpaddd %%ymm13, %%ymm\\reg, %%ymm\\reg\n"
      ".endr\n"
      "dec %%ecx\n"
      "jnz 1b\n"
      "vzeroupper\n"
      :
      : "i"(kPeakRounds)
      : "ecx", "cc", "memory", "xmm0", "xmm1", "xmm2", "xmm3", "xmm4", "xmm5", "xmm6", "xmm7", "xmm8", "xmm9", "xmm10",
        "xmm11", "xmm12", "xmm13", "xmm14", "xmm15");
}

/// 24 independent chains of vfmadd231ps: 16 products each. Zeros, which no processor is slow with.
inline void RunFloatPeakAvx512() {
  asm volatile(
      "mov %0, %%ecx\n"
      ".irp reg,0,1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17,18,19,20,21,22,23,30,31\n"
      "vpxord %%zmm\\reg, %%zmm\\reg, %%zmm\\reg\n"
      ".endr\n"
      "1:\n"
      ".irp reg,0,1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17,18,19,20,21,22,23\n"
      "vfmadd231ps %%zmm31, %%zmm30, %%zmm\\reg\n"
      ".endr\n"
      "dec %%ecx\n"
      "jnz 1b\n"
      "vzeroupper\n"
      :
      : "i"(kPeakRounds)
      : "ecx", "cc", "memory", "xmm0", "xmm1", "xmm2", "xmm3", "xmm4", "xmm5", "xmm6", "xmm7", "xmm8", "xmm9", "xmm10",
        "xmm11", "xmm12", "xmm13", "xmm14", "xmm15");
}

/// 12 independent chains of vfmadd231ps: 8 products each.
inline void RunFloatPeakAvx2() {
  asm volatile(
      "mov %0, %%ecx\n"
      ".irp reg,0,1,2,3,4,5,6,7,8,9,10,11,14,15\n"
      "vpxor %%ymm\\reg, %%ymm\\reg, %%ymm\\reg\n"
      ".endr\n"
      "1:\n"
      ".irp reg,0,1,2,3,4,5,6,7,8,9,10,11\n"
      "vfmadd231ps %%ymm15, %%ymm14, %%ymm\\reg\n"
      ".endr\n"
      "dec %%ecx\n"
      "jnz 1b\n"
      "vzeroupper\n"
      :
      : "i"(kPeakRounds)
      : "ecx", "cc", "memory", "xmm0", "xmm1", "xmm2", "xmm3", "xmm4", "xmm5", "xmm6", "xmm7", "xmm8", "xmm9", "xmm10",
        "xmm11", "xmm12", "xmm13", "xmm14", "xmm15");
}

inline constexpr PeakLoop kPeakAvx512{24.0 * 64 * kPeakRounds, RunPeakAvx512};
inline constexpr PeakLoop kPeakAvx2{12.0 * 16 * kPeakRounds, RunPeakAvx2};
inline constexpr PeakLoop kFloatPeakAvx512{24.0 * 16 * kPeakRounds, RunFloatPeakAvx512};
inline constexpr PeakLoop kFloatPeakAvx2{12.0 * 8 * kPeakRounds, RunFloatPeakAvx2};

}  // namespace rilievo::engine

#endif
