// The most that a core does of the instruction at the heart of a matching kernel, on registers alone.
#pragma once

namespace rilievo::bench {

struct PeakLoop {
  double products;  ///< multiply-adds of eight bits (or sixteen: AVX2) that one call makes
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

inline constexpr PeakLoop kPeakAvx512{24.0 * 64 * kPeakRounds, RunPeakAvx512};
inline constexpr PeakLoop kPeakAvx2{12.0 * 16 * kPeakRounds, RunPeakAvx2};

}  // namespace rilievo::bench
