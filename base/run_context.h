// What a stage is granted while it runs: stop requests, its seed, parallel loops, progress, the count of its kernels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string_view>

#include "base/error.h"

namespace rilievo {

/// A kernel whose use of the machine is counted: by the instruction at its heart.
struct KernelName {
  enum class Arithmetic : std::uint8_t { kBytes, kFloats };
  std::string_view name;  ///< of static storage
  Arithmetic arithmetic = Arithmetic::kFloats;
};

class RunContext {
 public:
  virtual ~RunContext() = default;
  /// True once the user asked to stop; long loops poll it (through ThrowIfStopped) at least every 100 ms.
  virtual bool StopRequested() const = 0;
  /// Base seed of the run; combine with the ids of the work item by SeedFor (base/rng.h).
  virtual std::uint64_t Seed() const = 0;
  /// Calls fn(begin, end) over disjoint ranges covering [0, n), each of at most `grain` items, possibly in parallel.
  /// Range borders are multiples of `grain`: they never depend on the number of threads.
  virtual void ParallelFor(std::size_t n, std::size_t grain,
                           const std::function<void(std::size_t, std::size_t)>& fn) = 0;
  /// Fraction done of this task, 0..1.
  virtual void ReportProgress(double fraction) = 0;
  /// Calls `body`; where runs are recorded, its processor time and its multiply-adds are counted for the kernel, so
  /// that a profile can set them against the peak of the machine. Costs some microseconds: for calls that take at least
  /// a hundred times that, or for a sample of shorter ones.
  virtual void RunKernel(const KernelName& /*kernel*/, double /*multiply_adds*/, const std::function<void()>& body) {
    body();
  }

  void ThrowIfStopped() const {
    if (StopRequested()) throw Cancelled();
  }
};

/// Runs everything on the calling thread: tests, tools and tasks that stay serial.
class SerialRunContext : public RunContext {
 public:
  explicit SerialRunContext(std::uint64_t seed = 0) : seed_(seed) {}
  bool StopRequested() const override { return false; }
  std::uint64_t Seed() const override { return seed_; }
  void ParallelFor(std::size_t n, std::size_t grain, const std::function<void(std::size_t, std::size_t)>& fn) override {
    for (std::size_t begin = 0; begin < n; begin += grain) fn(begin, begin + grain < n ? begin + grain : n);
  }
  void ReportProgress(double) override {}

 private:
  std::uint64_t seed_;
};

}  // namespace rilievo
