// Reads what the system says about this process in /proc.
#include "engine/memory_curve.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>

namespace rilievo::engine {

std::uint64_t ResidentBytes() {
  std::FILE* file = std::fopen("/proc/self/statm", "re");
  if (file == nullptr) return 0;
  unsigned long long size = 0, resident = 0;
  const int read = std::fscanf(file, "%llu %llu", &size, &resident);
  std::fclose(file);
  return read == 2 ? resident * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE)) : 0;
}

std::uint64_t PeakResidentBytes() {
  rusage usage{};
  return ::getrusage(RUSAGE_SELF, &usage) == 0 ? static_cast<std::uint64_t>(usage.ru_maxrss) * 1024 : 0;
}

std::vector<MemorySample> Halved(const std::vector<MemorySample>& samples) {
  std::vector<MemorySample> half;
  for (std::size_t i = 0; i + 1 < samples.size(); i += 2)
    half.push_back({samples[i + 1].time_s, std::max(samples[i].bytes, samples[i + 1].bytes)});
  if (samples.size() % 2 == 1) half.push_back(samples.back());
  return half;
}

MemoryCurve::MemoryCurve() : thread_([this] { Sample(); }) {}

MemoryCurve::~MemoryCurve() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

std::vector<MemorySample> MemoryCurve::Samples() const {
  const std::lock_guard lock(mutex_);
  return samples_;
}

void MemoryCurve::Sample() {
  const auto start = std::chrono::steady_clock::now();
  std::unique_lock lock(mutex_);
  while (!ends_) {
    const std::chrono::duration<double> now = std::chrono::steady_clock::now() - start;
    samples_.push_back({now.count(), ResidentBytes()});
    if (samples_.size() >= kMostSamples) {
      samples_ = Halved(samples_);
      interval_s_ *= 2;
    }
    wake_.wait_for(lock, std::chrono::duration<double>(interval_s_), [this] { return ends_; });
  }
}

}  // namespace rilievo::engine
