// Throughput of two threads over one's, and a loop of multiply-adds on registers to compare it with.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>

#include "base/error.h"
#include "bench/accuracy/features_clock.h"
#include "bench/accuracy/features_threads.h"

namespace rilievo::bench {

/// 12 independent chains of 256-bit fused multiply-adds: no memory, the clock of wide kernels.
inline void MultiplyAdd256(std::uint64_t rounds) {
  asm volatile(
      "1:\n"
      ".irp reg,0,1,2,3,4,5,6,7,8,9,10,11\n"
      "vfmadd231ps %%ymm15, %%ymm14, %%ymm\\reg\n"
      ".endr\n"
      "dec %0\n"
      "jnz 1b\n"
      "vzeroupper\n"
      : "+r"(rounds)
      :
      : "cc", "xmm0", "xmm1", "xmm2", "xmm3", "xmm4", "xmm5", "xmm6", "xmm7", "xmm8", "xmm9", "xmm10", "xmm11", "xmm12",
        "xmm13", "xmm14", "xmm15");
}

/// The same with 512 bits.
inline void MultiplyAdd512(std::uint64_t rounds) {
  asm volatile(
      "1:\n"
      ".irp reg,0,1,2,3,4,5,6,7,8,9,10,11\n"
      "vfmadd231ps %%zmm15, %%zmm14, %%zmm\\reg\n"
      ".endr\n"
      "dec %0\n"
      "jnz 1b\n"
      "vzeroupper\n"
      : "+r"(rounds)
      :
      : "cc", "xmm0", "xmm1", "xmm2", "xmm3", "xmm4", "xmm5", "xmm6", "xmm7", "xmm8", "xmm9", "xmm10", "xmm11", "xmm12",
        "xmm13", "xmm14", "xmm15");
}

using Loop = void (*)(std::uint64_t);

inline Loop ChooseLoop() {
  if (!__builtin_cpu_supports("fma")) throw Error(ErrorCode::kUnsupported, "", "this processor has no FMA");
  return __builtin_cpu_supports("avx512f") ? MultiplyAdd512 : MultiplyAdd256;
}

/// Rounds of the loop that take about `seconds`.
inline std::uint64_t RoundsFor(Loop loop, double seconds) {
  constexpr std::uint64_t kTrial = 20'000'000;
  const double trial_s = TimeOf([&] { loop(kTrial); }).cpu_s;
  return static_cast<std::uint64_t>(std::llround(kTrial * seconds / trial_s));
}

/// The least of several measurements, wall and CPU apart.
struct Least {
  Times times{.cpu_s = 1e300, .wall_s = 1e300};
  void Add(const Times& t) {
    times.cpu_s = std::min(times.cpu_s, t.cpu_s);
    times.wall_s = std::min(times.wall_s, t.wall_s);
  }
};

/// Each thread does the whole work: throughput of two is twice the work in the second's time.
inline nlohmann::ordered_json Scaling(const Least& one, const Least& two) {
  return {{"one_thread_s", one.times.wall_s},
          {"two_threads_s", two.times.wall_s},
          {"scaling", 2 * one.times.wall_s / two.times.wall_s},
          {"scaling_by_cpu_time", 2 * 2 * one.times.cpu_s / two.times.cpu_s}};
}

/// Measures `work` (of one thread, by its number) beside the loop, in turns, least time of `rounds`.
template <class Work>
nlohmann::ordered_json ScalingBesideFma(const Work& work, int rounds) {
  const Loop loop = ChooseLoop();
  const double once_s = TimeOf([&] { OnThreads(1, work); }).cpu_s;
  const std::uint64_t loop_rounds = RoundsFor(loop, std::clamp(once_s, 0.3, 2.0));
  const auto run_loop = [&](int) { loop(loop_rounds); };
  Least ours_one, ours_two, loop_one, loop_two;
  for (int i = 0; i < rounds; ++i) {
    ours_one.Add(TimeOf([&] { OnThreads(1, work); }));
    loop_one.Add(TimeOf([&] { OnThreads(1, run_loop); }));
    ours_two.Add(TimeOf([&] { OnThreads(2, work); }));
    loop_two.Add(TimeOf([&] { OnThreads(2, run_loop); }));
  }
  return {{"rounds", rounds}, {"ours", Scaling(ours_one, ours_two)}, {"fma", Scaling(loop_one, loop_two)}};
}

}  // namespace rilievo::bench
