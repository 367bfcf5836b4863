// Times the peak loops.
#include "engine/machine_peak.h"

#include <time.h>

#include <algorithm>

#include "base/kernel_choice.h"
#include "engine/peak_loops.h"

namespace rilievo::engine {
namespace {

double ThreadCpu_s() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace

#if defined(__x86_64__)

double MeasurePeak_per_s(KernelName::Arithmetic arithmetic) {
  const auto [scalar, avx2, avx512] = SupportedLevels();
  if (!avx2) return 0;
  const bool bytes = arithmetic == KernelName::Arithmetic::kBytes;
  const PeakLoop& loop = avx512 ? (bytes ? kPeakAvx512 : kFloatPeakAvx512) : (bytes ? kPeakAvx2 : kFloatPeakAvx2);
  double best_per_s = 0;
  const double begin_s = ThreadCpu_s();
  for (int i = 0; i < 3 || ThreadCpu_s() - begin_s < 0.05; ++i) {
    const double start_s = ThreadCpu_s();
    loop.run();
    best_per_s = std::max(best_per_s, loop.products / std::max(1e-9, ThreadCpu_s() - start_s));
  }
  return best_per_s;
}

#else

double MeasurePeak_per_s(KernelName::Arithmetic) { return 0; }

#endif

}  // namespace rilievo::engine
