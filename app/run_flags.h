// The flags of commands that run a plan: memory, threads, progress, trace; and running it.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "app/command.h"
#include "engine/executor.h"
#include "engine/plan.h"
#include "engine/progress.h"
#include "engine/trace.h"

namespace rilievo::app {

struct RunFlags {
  std::string memory;  ///< text; empty = a fixed share of the machine's memory
  int threads = 0;     ///< 0 = all processors this process may use
  bool quiet = false;
  std::string progress = "auto";  ///< auto, plain, json, quiet
  std::string trace;              ///< file, empty = none
  bool serial = false;            ///< the reference executor
};

/// --memory and --threads alone, for commands that run nothing for long.
void AddLimitFlags(CLI::App& command, RunFlags& flags);
void AddRunFlags(CLI::App& command, RunFlags& flags);

/// Limits after defaults. `budget_bytes` is what tasks may hold: the given memory less what the process itself needs.
struct Limits {
  std::uint64_t memory_bytes = 0, budget_bytes = 0;
  int threads = 1;
};

/// What a run is told beside its plan.
struct Accounts {
  std::filesystem::path kept_trace = {};          ///< where its trace is kept, empty = nowhere
  engine::ForecastSource forecast = {};           ///< of work to come, for the time left
  engine::Observer* forecast_observer = nullptr;  ///< what the forecast learns from
};

/// Runs plans one after the other under the same limits.
class PlanRunner {
 public:
  /// Throws Error when the memory is too small for the program itself.
  PlanRunner(RunFlags flags, ProgramContext& context);
  /// Memory that stays held beside the tasks from now on (a scene's surface): taken from the budget. Throws Error when
  /// nothing is left.
  void HoldResident(std::uint64_t bytes, const std::string& what);
  /// Without progress and trace: short preparations. Throws Cancelled, Error(kOutOfMemoryBudget).
  engine::ExecutionReport RunQuietly(engine::Plan& plan) const;
  /// With progress, and the trace written to --trace and to the workspace at the end, also of a
  /// cancelled run, and on the way. The first task that fails stops the run: what fails here is the world (disk,
  /// memory), not an image. Throws Cancelled when the user stopped it, the failed task's Error,
  /// Error(kOutOfMemoryBudget) when a task can never fit.
  engine::ExecutionReport Run(engine::Plan& plan, const Accounts& accounts = {}) const;
  const Limits& limits() const { return limits_; }
  /// What the process holds beside the tasks.
  std::uint64_t overhead_bytes() const { return limits_.memory_bytes - limits_.budget_bytes; }

 private:
  engine::ExecutionReport Execute(engine::Plan& plan, std::vector<engine::Observer*> observers) const;
  RunFlags flags_;
  Limits limits_;
  ProgramContext& context_;
  std::unique_ptr<engine::Executor> executor_;
};

}  // namespace rilievo::app
