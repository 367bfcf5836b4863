// Resolves limits and runs plans with progress, trace and cancellation.
#include "app/run_flags.h"

#include <fmt/format.h>
#include <sched.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "base/units.h"

namespace rilievo::app {
namespace {

/// The machine's memory, or the control group's limit where that is smaller.
std::uint64_t AvailableMemoryBytes() {
  std::uint64_t bytes =
      static_cast<std::uint64_t>(sysconf(_SC_PHYS_PAGES)) * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
  std::uint64_t limit = 0;
  if (std::ifstream("/sys/fs/cgroup/memory.max") >> limit) bytes = std::min(bytes, limit);
  return bytes;
}

int AvailableThreads() {
  cpu_set_t set;
  CPU_ZERO(&set);
  return sched_getaffinity(0, sizeof set, &set) == 0 ? std::max(1, CPU_COUNT(&set)) : 1;
}

/// Memory that the program itself needs besides its tasks: libraries, stacks, allocator slack.
constexpr std::uint64_t kProcessReserveBytes = 160 * kMebibyte;

/// Throws Error when the memory is too small for the program itself.
Limits ResolveLimits(const RunFlags& flags) {
  Limits limits;
  limits.memory_bytes = flags.memory.empty() ? AvailableMemoryBytes() / 4 * 3 : ParseBytes(flags.memory);
  limits.threads = flags.threads > 0 ? flags.threads : AvailableThreads();
  if (limits.memory_bytes <= kProcessReserveBytes + 32 * kMebibyte)
    throw Error(ErrorCode::kOutOfMemoryBudget, "--memory",
                FormatBytes(limits.memory_bytes) + " is too small for the program itself",
                fmt::format("use {} or more", FormatBytes(kProcessReserveBytes + 64 * kMebibyte)));
  limits.budget_bytes = limits.memory_bytes - kProcessReserveBytes;
  return limits;
}

engine::ProgressStyle StyleOf(const RunFlags& flags) {
  if (flags.quiet || flags.progress == "quiet") return engine::ProgressStyle::kQuiet;
  if (flags.progress == "json") return engine::ProgressStyle::kJson;
  if (flags.progress == "plain") return engine::ProgressStyle::kPlain;
  return engine::ProgressStyle::kAuto;
}

/// Ends the run at the first task that fails, and keeps its line.
class StopAtFirstFailure : public engine::Observer {
 public:
  explicit StopAtFirstFailure(engine::StopSource& stop) : stop_(stop) {}
  void OnTaskFinished(TaskId, const engine::Task&, const engine::TaskOutcome& outcome,
                      const engine::TaskSpan&) override {
    if (outcome.state != engine::TaskState::kFailed || error) return;
    error = outcome.error;
    stop_.RequestStop();
  }
  std::optional<std::string> error;

 private:
  engine::StopSource& stop_;
};

/// The trace, written at the end, and by the signal thread when the program leaves before that.
class GuardedTrace : public engine::Observer {
 public:
  GuardedTrace(std::string path, ProgramContext& context) : path_(std::move(path)), context_(context) {
    if (path_.empty()) return;
    trace_.Write(path_);  // a path that cannot be written is known before the run
    const std::lock_guard lock(context_.before_exit_mutex);
    context_.before_exit = [this] { Write(); };
  }
  ~GuardedTrace() override { Finish(); }
  GuardedTrace(const GuardedTrace&) = delete;
  GuardedTrace& operator=(const GuardedTrace&) = delete;

  void Finish() {
    if (path_.empty()) return;
    {
      const std::lock_guard lock(context_.before_exit_mutex);
      context_.before_exit = nullptr;
    }
    Write();
    path_.clear();
  }
  void OnTaskAdded(TaskId id, const engine::Task& task) override {
    const std::lock_guard lock(mutex_);
    trace_.OnTaskAdded(id, task);
  }
  void OnTaskStarted(TaskId id, const engine::Task& task, int worker) override {
    const std::lock_guard lock(mutex_);
    trace_.OnTaskStarted(id, task, worker);
  }
  void OnTaskFinished(TaskId id, const engine::Task& task, const engine::TaskOutcome& outcome,
                      const engine::TaskSpan& span) override {
    const std::lock_guard lock(mutex_);
    trace_.OnTaskFinished(id, task, outcome, span);
  }

 private:
  /// A trace that cannot be written takes nothing from the result: a warning.
  void Write() {
    const std::lock_guard lock(mutex_);
    try {
      trace_.Write(path_);
    } catch (const Error& error) {
      PrintWarning(context_, std::string("the trace is lost: ") + error.what());
    }
  }

  std::string path_;
  ProgramContext& context_;
  std::mutex mutex_;
  engine::Trace trace_;
};

}  // namespace

void AddLimitFlags(CLI::App& command, RunFlags& flags) {
  command
      .add_option("--memory", flags.memory,
                  "Most memory the program may hold, e.g. 4GiB; default: three quarters of the machine's")
      ->type_name("SIZE")
      ->group("Run");
  command.add_option("--threads", flags.threads, "Threads; 0 = every processor. Never changes a result")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str()
      ->group("Run");
}

void AddRunFlags(CLI::App& command, RunFlags& flags) {
  AddLimitFlags(command, flags);
  command.add_flag("--quiet", flags.quiet, "Print nothing but errors")->group("Run");
  command
      .add_option(
          "--progress", flags.progress,
          "How progress is shown on stderr: auto (one line a stage on a terminal), plain lines, json lines, quiet")
      ->check(CLI::IsMember({"auto", "plain", "json", "quiet"}))
      ->capture_default_str()
      ->type_name("STYLE")
      ->group("Run");
  command.add_option("--trace", flags.trace, "Write a Chrome trace of all tasks (opens in Perfetto)")
      ->type_name("FILE")
      ->group("Run");
  command.add_flag("--serial", flags.serial, "Run on one thread in plan order: the reference executor")->group("Run");
}

PlanRunner::PlanRunner(RunFlags flags, ProgramContext& context)
    : flags_(std::move(flags)),
      limits_(ResolveLimits(flags_)),
      context_(context),
      executor_(flags_.serial ? engine::MakeSerialExecutor() : engine::MakeFlowExecutor()) {
  context_.json_messages = flags_.progress == "json" && !flags_.quiet;
}

void PlanRunner::HoldResident(std::uint64_t bytes, const std::string& what) {
  if (bytes + 32 * kMebibyte > limits_.budget_bytes)
    throw Error(
        ErrorCode::kOutOfMemoryBudget, "--memory",
        fmt::format("{} is too small to hold {} ({})", FormatBytes(limits_.memory_bytes), what, FormatBytes(bytes)),
        fmt::format("use --memory {}MiB or more", (overhead_bytes() + bytes) / kMebibyte + 64));
  limits_.budget_bytes -= bytes;
}

engine::ExecutionReport PlanRunner::Execute(engine::Plan& plan, std::vector<engine::Observer*> observers) const {
  engine::ExecutionOptions options;
  options.threads = limits_.threads;
  options.memory_bytes = limits_.budget_bytes;
  options.stop = &context_.stop;
  options.observers = std::move(observers);
  return executor_->Run(plan, options);
}

engine::ExecutionReport PlanRunner::RunQuietly(engine::Plan& plan) const {
  engine::ExecutionReport report = Execute(plan, {});
  if (report.cancelled) throw Cancelled();
  return report;
}

engine::ExecutionReport PlanRunner::Run(engine::Plan& plan) const {
  engine::Progress progress(stderr, StyleOf(flags_));
  StopAtFirstFailure failure(context_.stop);
  GuardedTrace trace(flags_.trace, context_);
  std::vector<engine::Observer*> observers{&progress, &failure};
  if (!flags_.trace.empty()) observers.push_back(&trace);
  engine::ExecutionReport report = Execute(plan, observers);
  progress.Finish();
  trace.Finish();
  if (failure.error) throw Error(ErrorCode::kIo, "", *failure.error);
  if (report.cancelled) throw Cancelled();
  return report;
}

}  // namespace rilievo::app
