// Resolves limits and runs plans with progress, trace and cancellation.
#include "app/run_flags.h"

#include <fmt/format.h>
#include <sched.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
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
  limits.threads = flags.serial ? 1 : flags.threads > 0 ? flags.threads : AvailableThreads();
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

/// The trace of a run: written at its end, every now and then before (a killed run has most of its trace), and by the
/// signal thread when the program leaves early.
class GuardedTrace : public engine::Observer {
 public:
  /// `file` is the user's, empty = none; `kept` is the workspace's, which holds that of the run before until there is
  /// something to say about this one.
  GuardedTrace(const std::string& file, const std::filesystem::path& kept, bool quiet, engine::RunFacts facts,
               ProgramContext& context)
      : context_(context), warned_(quiet && file.empty()), trace_(std::move(facts), &memory_) {
    if (!file.empty()) {
      trace_.Write(file);  // a path that cannot be written is known before the run
      paths_.emplace_back(file);
    }
    if (!kept.empty()) paths_.push_back(kept);
    const std::lock_guard lock(context_.before_exit_mutex);
    context_.before_exit = [this] {
      const std::lock_guard guard(mutex_);
      Write();
    };
  }
  ~GuardedTrace() override { Finish(); }
  GuardedTrace(const GuardedTrace&) = delete;
  GuardedTrace& operator=(const GuardedTrace&) = delete;

  void Finish() {
    {
      const std::lock_guard lock(context_.before_exit_mutex);
      context_.before_exit = nullptr;
    }
    const std::lock_guard lock(mutex_);
    Write();
    paths_.clear();
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
    if (Clock::now() >= next_write_) Write();
  }

 private:
  using Clock = std::chrono::steady_clock;

  /// A trace that cannot be written takes nothing from the result: a warning.
  void Write() {
    constexpr auto kInterval = std::chrono::seconds(20);
    constexpr int kWritingShare = 200;  // writing takes half a percent of the time at most
    const auto start = Clock::now();
    for (const auto& path : paths_) {
      try {
        trace_.Write(path);
      } catch (const Error& error) {
        if (!warned_) PrintWarning(context_, std::string("the trace is lost: ") + error.what());
        warned_ = true;
      }
    }
    const auto end = Clock::now();
    next_write_ = end + std::max<Clock::duration>(kInterval, kWritingShare * (end - start));
  }

  ProgramContext& context_;
  std::mutex mutex_;
  std::vector<std::filesystem::path> paths_;
  bool warned_;  ///< or not to be
  Clock::time_point next_write_ = Clock::now() + std::chrono::seconds(20);
  engine::MemoryCurve memory_;
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

engine::ExecutionReport PlanRunner::Run(engine::Plan& plan, const Accounts& accounts) const {
  engine::Progress progress(stderr, StyleOf(flags_), engine::Progress::SteadyClock(), accounts.forecast);
  StopAtFirstFailure failure(context_.stop);
  const std::chrono::duration<double> before = std::chrono::steady_clock::now() - context_.start;
  GuardedTrace trace(flags_.trace, accounts.kept_trace, flags_.quiet,
                     {.threads = limits_.threads,
                      .memory_bytes = limits_.budget_bytes,
                      .overhead_bytes = overhead_bytes(),
                      .before_s = before.count(),
                      .processor = engine::ProcessorName()},
                     context_);
  std::vector<engine::Observer*> observers{&progress, &failure, &trace};
  if (accounts.forecast_observer != nullptr) observers.insert(observers.begin(), accounts.forecast_observer);
  engine::ExecutionReport report = Execute(plan, std::move(observers));
  progress.Finish();
  trace.Finish();
  if (failure.error) throw Error(ErrorCode::kIo, "", *failure.error);
  if (report.cancelled) throw Cancelled();
  return report;
}

}  // namespace rilievo::app
