// Threads of the benches: the stages themselves start none.
#pragma once

#include <algorithm>
#include <atomic>
#include <functional>
#include <thread>
#include <vector>

#include "base/run_context.h"

namespace rilievo::bench {

/// Runs work(0) ... work(threads - 1) at once, each on a thread of its own.
inline void OnThreads(int threads, const std::function<void(int)>& work) {
  std::vector<std::jthread> pool;
  for (int t = 0; t < threads; ++t) pool.emplace_back(work, t);
}

/// Spreads parallel loops over threads that take the next range as they get free.
class ThreadedRunContext : public RunContext {
 public:
  explicit ThreadedRunContext(int threads) : threads_(threads) {}
  bool StopRequested() const override { return false; }
  std::uint64_t Seed() const override { return 0; }
  void ParallelFor(std::size_t n, std::size_t grain, const std::function<void(std::size_t, std::size_t)>& fn) override {
    std::atomic<std::size_t> next{0};
    OnThreads(threads_, [&](int) {
      for (std::size_t begin = next.fetch_add(grain); begin < n; begin = next.fetch_add(grain)) {
        fn(begin, std::min(begin + grain, n));
      }
    });
  }
  void ReportProgress(double) override {}

 private:
  int threads_;
};

}  // namespace rilievo::bench
