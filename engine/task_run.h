// One run of one task: its context, what it counted, and its outcome.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <mutex>
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
  TaskRun(const ExecutionOptions& options, const RunClock& clock) : options_(options), clock_(clock) {}

  /// Calls the task's body and turns what it throws into an outcome: Cancelled -> kCancelled, anything else -> kFailed
  /// with one line. Never throws.
  TaskOutcome Execute(const Task& task) noexcept;
  /// Ends the span: end, processor time, bytes, kernels, helpers. After Execute, once.
  void CompleteSpan(TaskSpan& span);

  bool StopRequested() const override { return options_.stop != nullptr && options_.stop->StopRequested(); }
  std::uint64_t Seed() const override { return options_.seed; }
  void CountBytes(std::uint64_t read_bytes, std::uint64_t written_bytes) override;
  void MarkReused() override { reused_.store(true, std::memory_order_relaxed); }
  void Grow(std::function<void(Plan&)> grow) override { grows_.push_back(std::move(grow)); }
  void RunKernel(const KernelName& kernel, double multiply_adds, const std::function<void()>& body) override;

  std::vector<std::function<void(Plan&)>> TakeGrows() { return std::move(grows_); }

 protected:
  /// What the calling thread does for this task: kernels that it is in pass on to helpers of a parallel loop.
  static const KernelName* CurrentKernel();
  /// Runs a part of a parallel loop. On a thread that is not in this task yet, its processor time is added to the task
  /// and to the kernel that the loop was started in, and its span to the helpers.
  void RunPart(const KernelName* kernel, int worker, const std::function<void()>& part);

 private:
  void AddKernel(const KernelName& kernel, double multiply_adds, double cpu_s);
  void AddHelper(int worker, double start_s, double end_s);

  const ExecutionOptions& options_;
  const RunClock& clock_;
  std::atomic<std::uint64_t> read_bytes_{0}, written_bytes_{0};
  std::atomic<bool> reused_{false};
  std::vector<std::function<void(Plan&)>> grows_;

  std::mutex counts_mutex_;  ///< guards what follows
  double cpu_s_ = 0;
  std::vector<KernelUse> kernels_;
  std::vector<HelperSpan> helpers_;
};

/// Runs what the task asked for by Grow. When a growth throws, the task has failed with that line, and the tasks added
/// until then are to be skipped. Returns the size the plan had before.
std::size_t GrowPlan(Plan& plan, TaskId id, const std::vector<std::function<void(Plan&)>>& grows, TaskOutcome& outcome);

/// Counts a final outcome into the report's totals.
void CountOutcome(const TaskOutcome& outcome, ExecutionReport& report);

}  // namespace rilievo::engine
