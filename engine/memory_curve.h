// How much memory the process held over time, sampled by a thread of its own.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <thread>
#include <vector>

namespace rilievo::engine {

struct MemorySample {
  double time_s = 0;  ///< since the sampling began; the bytes are the largest seen since the sample before
  std::uint64_t bytes = 0;
};

/// Samples the resident bytes of the process while it lives. Bounded: when kMostSamples are full, two become one and
/// the interval doubles, so that any run has a few thousand.
class MemoryCurve {
 public:
  MemoryCurve();
  ~MemoryCurve();
  MemoryCurve(const MemoryCurve&) = delete;
  MemoryCurve& operator=(const MemoryCurve&) = delete;

  std::vector<MemorySample> Samples() const;

 private:
  static constexpr std::size_t kMostSamples = 1024;
  void Sample();

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  bool ends_ = false;
  double interval_s_ = 0.02;
  std::vector<MemorySample> samples_;
  std::thread thread_;
};

/// Joins neighbours, two by two, into one sample each: the later time, the larger bytes. A last odd one stays.
std::vector<MemorySample> Halved(const std::vector<MemorySample>& samples);

/// Resident bytes of this process, now and at most so far; 0 where the system does not say.
std::uint64_t ResidentBytes();
std::uint64_t PeakResidentBytes();

}  // namespace rilievo::engine
