// CPU and wall time of a piece of work.
#pragma once

#include <ctime>

namespace rilievo::bench {

inline double Seconds(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// CPU time of all threads of the process, user and system.
inline double CpuSeconds() { return Seconds(CLOCK_PROCESS_CPUTIME_ID); }
inline double WallSeconds() { return Seconds(CLOCK_MONOTONIC); }

struct Times {
  double cpu_s = 0, wall_s = 0;
};

template <class F>
Times TimeOf(F&& work) {
  const double cpu = CpuSeconds(), wall = WallSeconds();
  work();
  return {.cpu_s = CpuSeconds() - cpu, .wall_s = WallSeconds() - wall};
}

}  // namespace rilievo::bench
