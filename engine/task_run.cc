// Runs a task's body and puts its end into words.
#include "engine/task_run.h"

#include <time.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <new>
#include <string>
#include <utility>

#include "base/error.h"

namespace rilievo::engine {
namespace {

std::string OneLine(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == '\n' || c == '\r'; }, ' ');
  return text;
}

/// Calls `body`; how it ended, with the line for a failure.
template <class Body>
TaskOutcome Guarded(const std::string& name, Body&& body) {
  TaskOutcome outcome;
  outcome.state = TaskState::kFailed;
  try {
    body();
    outcome.state = TaskState::kDone;
  } catch (const Cancelled&) {
    outcome.state = TaskState::kCancelled;
  } catch (const Error& error) {
    outcome.error = OneLine(error.what());
  } catch (const std::bad_alloc&) {
    outcome.error = name + ": the system has no memory left (close other programs, or lower --memory or --threads)";
  } catch (const std::exception& error) {
    outcome.error = OneLine(name + ": " + error.what());
  } catch (...) {
    outcome.error = name + ": failed without saying why";
  }
  return outcome;
}

/// Processor time of the calling thread.
double ThreadCpu_s() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// The task whose time the calling thread's is, and the kernel that it is in.
struct ThreadPlace {
  const TaskRun* run = nullptr;
  const KernelName* kernel = nullptr;
};
thread_local ThreadPlace thread_place;

/// Takes a place for a scope; an exception leaves it, too.
class Placed {
 public:
  explicit Placed(ThreadPlace place) : before_(std::exchange(thread_place, place)) {}
  ~Placed() { thread_place = before_; }
  Placed(const Placed&) = delete;
  Placed& operator=(const Placed&) = delete;

 private:
  ThreadPlace before_;
};

/// Calls fn(seconds of processor time) at the end of the scope, whichever way it ends.
template <class Fn>
class CpuTimed {
 public:
  explicit CpuTimed(Fn fn) : fn_(std::move(fn)) {}
  ~CpuTimed() { fn_(ThreadCpu_s() - start_s_); }
  CpuTimed(const CpuTimed&) = delete;
  CpuTimed& operator=(const CpuTimed&) = delete;

 private:
  Fn fn_;
  double start_s_ = ThreadCpu_s();
};

/// A helper that comes back within this time has not been away; longer ones as a task has more of them, so that a trace
/// stays small.
constexpr double kHelperPause_s = 1e-3;
constexpr std::size_t kHelperSpans = 256;

}  // namespace

TaskOutcome TaskRun::Execute(const Task& task) noexcept {
  TaskOutcome outcome = Guarded(task.name, [&] {
    const Placed placed({this, nullptr});
    const CpuTimed timed([this](double cpu_s) {
      const std::lock_guard lock(counts_mutex_);
      cpu_s_ += cpu_s;
    });
    task.run(*this);
  });
  outcome.reused = outcome.state == TaskState::kDone && reused_.load(std::memory_order_relaxed);
  outcome.read_bytes = read_bytes_.load(std::memory_order_relaxed);
  outcome.written_bytes = written_bytes_.load(std::memory_order_relaxed);
  return outcome;
}

void TaskRun::CompleteSpan(TaskSpan& span) {
  const std::lock_guard lock(counts_mutex_);
  span.end_s = clock_.Now_s();
  span.cpu_s = cpu_s_;
  span.read_bytes = read_bytes_.load(std::memory_order_relaxed);
  span.written_bytes = written_bytes_.load(std::memory_order_relaxed);
  span.kernels = std::move(kernels_);
  span.helpers = std::move(helpers_);
}

const KernelName* TaskRun::CurrentKernel() { return thread_place.kernel; }

void TaskRun::RunKernel(const KernelName& kernel, double multiply_adds, const std::function<void()>& body) {
  const Placed placed({thread_place.run, &kernel});
  const CpuTimed timed([&](double cpu_s) { AddKernel(kernel, multiply_adds, cpu_s); });
  body();
}

void TaskRun::RunPart(const KernelName* kernel, int worker, const std::function<void()>& part) {
  if (thread_place.run == this) return part();
  const Placed placed({this, kernel});
  const double start_s = clock_.Now_s();
  const CpuTimed timed([&](double cpu_s) {
    if (kernel != nullptr) AddKernel(*kernel, 0, cpu_s);
    const std::lock_guard lock(counts_mutex_);
    cpu_s_ += cpu_s;
    AddHelper(worker, start_s, clock_.Now_s());
  });
  part();
}

void TaskRun::AddKernel(const KernelName& kernel, double multiply_adds, double cpu_s) {
  const std::lock_guard lock(counts_mutex_);
  auto found = std::find_if(kernels_.begin(), kernels_.end(),
                            [&](const KernelUse& use) { return use.kernel.name == kernel.name; });
  if (found == kernels_.end()) found = kernels_.insert(kernels_.end(), KernelUse{kernel, 0, 0});
  found->multiply_adds += multiply_adds;
  found->cpu_s += cpu_s;
}

void TaskRun::AddHelper(int worker, double start_s, double end_s) {
  const auto last =
      std::find_if(helpers_.rbegin(), helpers_.rend(), [&](const HelperSpan& h) { return h.worker == worker; });
  const double pause_s = kHelperPause_s * std::exp2(static_cast<double>(helpers_.size() / kHelperSpans));
  if (last != helpers_.rend() && start_s - last->end_s < pause_s)
    last->end_s = end_s;
  else
    helpers_.push_back({worker, start_s, end_s});
}

void TaskRun::CountBytes(std::uint64_t read_bytes, std::uint64_t written_bytes) {
  read_bytes_.fetch_add(read_bytes, std::memory_order_relaxed);
  written_bytes_.fetch_add(written_bytes, std::memory_order_relaxed);
}

std::size_t GrowPlan(Plan& plan, TaskId id, const std::vector<std::function<void(Plan&)>>& grows,
                     TaskOutcome& outcome) {
  const std::size_t old_size = plan.size();
  const TaskOutcome grown = Guarded(plan.task(id).name, [&] {
    for (const auto& grow : grows) grow(plan);
  });
  if (grown.state != TaskState::kDone) outcome = grown;
  return old_size;
}

void CountOutcome(const TaskOutcome& outcome, ExecutionReport& report) {
  report.done += outcome.state == TaskState::kDone;
  report.failed += outcome.state == TaskState::kFailed;
  report.skipped += outcome.state == TaskState::kSkipped;
  report.reused += outcome.reused;
  report.cancelled |= outcome.state == TaskState::kCancelled;
}

}  // namespace rilievo::engine
