// One run of one task: its context, what it counted, and its outcome.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <vector>

#include "engine/executor.h"

namespace rilievo::engine {

/// Seconds since the run began.
class RunClock {
 public:
  double Now_s() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// The part of a TaskContext that every executor shares; they differ in ParallelFor and ReportProgress. All but Grow
/// may be called from the inside of a ParallelFor.
class TaskRun : public TaskContext {
 public:
  explicit TaskRun(const ExecutionOptions& options) : options_(options) {}

  /// Calls the task's body and turns what it throws into an outcome: Cancelled -> kCancelled, anything else -> kFailed
  /// with one line. Never throws.
  TaskOutcome Execute(const Task& task) noexcept;

  bool StopRequested() const override { return options_.stop != nullptr && options_.stop->StopRequested(); }
  std::uint64_t Seed() const override { return options_.seed; }
  void CountBytes(std::uint64_t read_bytes, std::uint64_t written_bytes) override;
  void MarkReused() override { reused_.store(true, std::memory_order_relaxed); }
  void Grow(std::function<void(Plan&)> grow) override { grows_.push_back(std::move(grow)); }

  std::uint64_t read_bytes() const { return read_bytes_.load(std::memory_order_relaxed); }
  std::uint64_t written_bytes() const { return written_bytes_.load(std::memory_order_relaxed); }
  std::vector<std::function<void(Plan&)>> TakeGrows() { return std::move(grows_); }

 private:
  const ExecutionOptions& options_;
  std::atomic<std::uint64_t> read_bytes_{0}, written_bytes_{0};
  std::atomic<bool> reused_{false};
  std::vector<std::function<void(Plan&)>> grows_;
};

/// Runs what the task asked for by Grow. When a growth throws, the task has failed with that line, and the tasks added
/// until then are to be skipped. Returns the size the plan had before.
std::size_t GrowPlan(Plan& plan, TaskId id, const std::vector<std::function<void(Plan&)>>& grows, TaskOutcome& outcome);

/// Counts a final outcome into the report's totals.
void CountOutcome(const TaskOutcome& outcome, ExecutionReport& report);

}  // namespace rilievo::engine
