// The interface of executors: run a plan within a memory budget; the serial one is the reference.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "engine/plan.h"

namespace rilievo::engine {

/// Set from any thread or a signal handler; polled by executors and tasks.
class StopSource {
 public:
  void RequestStop() { stop_.store(true, std::memory_order_relaxed); }
  bool StopRequested() const { return stop_.load(std::memory_order_relaxed); }

 private:
  std::atomic<bool> stop_{false};
};

enum class TaskState : std::uint8_t { kPending, kRunning, kDone, kFailed, kSkipped, kCancelled };

struct TaskOutcome {
  TaskState state = TaskState::kPending;
  bool reused = false;
  std::uint64_t read_bytes = 0, written_bytes = 0;  ///< counted by the task
  std::string error;                                ///< one line, for kFailed
};

/// What a task spent in a kernel: see RunContext::RunKernel.
struct KernelUse {
  KernelName kernel;
  double multiply_adds = 0, cpu_s = 0;
};

/// Another worker inside a parallel loop of the task.
struct HelperSpan {
  int worker = 0;
  double start_s = 0, end_s = 0;
};

struct TaskSpan {
  TaskId task;
  int worker = 0;
  double start_s = 0, end_s = 0;  ///< since the run began
  double cpu_s = 0;               ///< processor time, of helpers too
  std::uint64_t read_bytes = 0, written_bytes = 0;
  bool reused = false;
  std::vector<KernelUse> kernels = {};
  std::vector<HelperSpan> helpers = {};  ///< by end
};

/// Told of events from the executor, never concurrently.
class Observer {
 public:
  virtual ~Observer() = default;
  virtual void OnTaskAdded(TaskId, const Task&) {}
  virtual void OnTaskStarted(TaskId, const Task&, int /*worker*/) {}
  virtual void OnTaskProgress(TaskId, const Task&, double /*fraction*/) {}
  virtual void OnTaskFinished(TaskId, const Task&, const TaskOutcome&, const TaskSpan&) {}
};

struct ExecutionOptions {
  int threads = 1;
  std::uint64_t memory_bytes = 0;  ///< budget; 0 = unlimited
  std::uint64_t seed = 0;
  const StopSource* stop = nullptr;
  std::vector<Observer*> observers = {};
};

struct ExecutionReport {
  std::vector<TaskOutcome> outcomes;  ///< by task id
  std::uint64_t peak_live_bytes = 0;  ///< largest sum of admitted costs and retained results
  bool cancelled = false;
  std::size_t failed = 0, skipped = 0, done = 0, reused = 0;
};

/// Runs every task whose needs succeeded. A failed task (it threw) skips its descendants only. A task whose peak_bytes
/// can never fit the budget throws Error(kOutOfMemoryBudget) from Run before anything starts when it is in the plan
/// from the beginning, and fails with that error when it was added later.
class Executor {
 public:
  virtual ~Executor() = default;
  virtual ExecutionReport Run(Plan& plan, const ExecutionOptions& options) = 0;
};

/// The reference: one thread, always the lowest ready task.
std::unique_ptr<Executor> MakeSerialExecutor();
/// oneTBB flow graph; gives the same results.
std::unique_ptr<Executor> MakeFlowExecutor();

}  // namespace rilievo::engine
