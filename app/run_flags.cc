// Resolves limits and runs plans with progress, trace and cancellation.
#include "app/run_flags.h"

#include <fmt/format.h>
#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <utility>

namespace rilievo::app {
namespace {

/// The machine's memory, or the control group's limit where that is smaller.
std::uint64_t AvailableMemoryBytes() {
  std::uint64_t bytes = static_cast<std::uint64_t>(sysconf(_SC_PHYS_PAGES)) * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
  std::uint64_t limit = 0;
  if (std::ifstream("/sys/fs/cgroup/memory.max") >> limit) bytes = std::min(bytes, limit);
  return bytes;
}

int AvailableThreads() {
  cpu_set_t set;
  CPU_ZERO(&set);
  return sched_getaffinity(0, sizeof set, &set) == 0 ? std::max(1, CPU_COUNT(&set)) : 1;
}

engine::ProgressStyle StyleOf(const RunFlags& flags) {
  if (flags.quiet || flags.progress == "quiet") return engine::ProgressStyle::kQuiet;
  if (flags.progress == "json") return engine::ProgressStyle::kJson;
  if (flags.progress == "plain") return engine::ProgressStyle::kPlain;
  return engine::ProgressStyle::kAuto;
}

}  // namespace

void AddRunFlags(CLI::App& command, RunFlags& flags) {
  command.add_option("--memory", flags.memory, "Most memory the program may hold, e.g. 4GiB; default three quarters of the machine's")->type_name("SIZE")->group("Run");
  command.add_option("--threads", flags.threads, "Threads; 0 = every processor. Never changes a result")->check(CLI::Range(0, 1024))->capture_default_str()->group("Run");
  command.add_flag("--quiet", flags.quiet, "Print nothing but errors")->group("Run");
  command.add_option("--progress", flags.progress, "How progress is shown on stderr")->check(CLI::IsMember({"auto", "plain", "json", "quiet"}))->capture_default_str()->group("Run");
  command.add_option("--trace", flags.trace, "Write a Chrome trace of all tasks (opens in Perfetto)")->type_name("FILE")->group("Run");
  command.add_flag("--serial", flags.serial, "Run on one thread in plan order: the reference executor")->group("Run");
}

Limits ResolveLimits(const RunFlags& flags) {
  Limits limits;
  limits.memory_bytes = flags.memory.empty() ? AvailableMemoryBytes() / 4 * 3 : ParseBytes(flags.memory);
  limits.threads = flags.threads > 0 ? flags.threads : AvailableThreads();
  if (limits.memory_bytes <= kProcessReserveBytes + 32 * kMebibyte)
    throw Error(ErrorCode::kOutOfMemoryBudget, "--memory", FormatBytes(limits.memory_bytes) + " is too small for the program itself",
                fmt::format("use {} or more", FormatBytes(kProcessReserveBytes + 64 * kMebibyte)));
  limits.budget_bytes = limits.memory_bytes - kProcessReserveBytes;
  return limits;
}

PlanRunner::PlanRunner(RunFlags flags, const Limits& limits, const engine::StopSource& stop)
    : flags_(std::move(flags)), limits_(limits), stop_(stop),
      executor_(flags_.serial ? engine::MakeSerialExecutor() : engine::MakeFlowExecutor()) {}

void PlanRunner::HoldResident(std::uint64_t bytes, const std::string& what) {
  if (bytes + 32 * kMebibyte > limits_.budget_bytes)
    throw Error(ErrorCode::kOutOfMemoryBudget, "--memory", fmt::format("{} is too small to hold {} ({})", FormatBytes(limits_.memory_bytes), what, FormatBytes(bytes)),
                "use more");
  limits_.budget_bytes -= bytes;
}

engine::ExecutionReport PlanRunner::Execute(engine::Plan& plan, std::vector<engine::Observer*> observers) const {
  engine::ExecutionOptions options;
  options.threads = limits_.threads;
  options.memory_bytes = limits_.budget_bytes;
  options.stop = &stop_;
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
  engine::Trace trace;
  std::vector<engine::Observer*> observers{&progress};
  if (!flags_.trace.empty()) observers.push_back(&trace);
  engine::ExecutionReport report = Execute(plan, observers);
  progress.Finish();
  if (!flags_.trace.empty()) trace.Write(flags_.trace);
  if (report.cancelled) throw Cancelled();
  return report;
}

}  // namespace rilievo::app
