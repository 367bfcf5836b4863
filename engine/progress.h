// Shows how far a run is: lines for people, JSON lines for programs.
#pragma once

#include <cstddef>
#include <cstdio>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "engine/executor.h"
#include "engine/time_model.h"

namespace rilievo::engine {

enum class ProgressStyle { kAuto, kTerminal, kPlain, kJson, kQuiet };

/// Counts of one stage, or of all of them, and what they say about the time left.
struct ProgressCounts {
  std::size_t done = 0, total = 0;  ///< done: ended in whatever way
  std::size_t reused = 0, failed = 0, skipped = 0, cancelled = 0;
  double total_work = 0, ended_work = 0;  ///< declared; every task counts for a little
  double computed_work = 0;               ///< of tasks that ran and were not reused: only these tell the speed
  std::size_t computed = 0;
  std::uint64_t read_bytes = 0, written_bytes = 0;
  double first_start_s = -1, last_end_s = 0;
};

/// What is known of a run beyond its plan; asked at each estimate, between events of the executor.
using ForecastSource = std::function<RunForecast()>;

/// kTerminal: one line a stage, rewritten in place, and the total; kPlain: a line for each stage that changed, at most
/// every two seconds; kJson: one object a line, {"event": "task" | "stage" | "end", "stage", "done", "total", "reused",
/// "failed", "rate_per_s", "eta_s", "fraction", "read_bytes", "written_bytes", "elapsed_s", "total_fraction",
/// "total_eta_s"}, with "task", "state" and "error" in "task" events; kQuiet: nothing; kAuto: kTerminal or kPlain by
/// what `out` is. The time left of a stage is its declared work left at the speed measured so far; that of the run is
/// TimeModel's; null or "-" until known.
class Progress : public Observer {
 public:
  using Clock = std::function<double()>;  ///< seconds, from any origin

  Progress(std::FILE* out, ProgressStyle style, Clock now_s = SteadyClock(), ForecastSource forecast = {});
  ~Progress() override { Finish(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// The last lines, once; call it when the run has ended, before anything else is printed.
  void Finish();

  void OnTaskAdded(TaskId id, const Task& task) override;
  void OnTaskStarted(TaskId id, const Task& task, int worker) override;
  void OnTaskProgress(TaskId id, const Task& task, double fraction) override;
  void OnTaskFinished(TaskId id, const Task& task, const TaskOutcome& outcome, const TaskSpan& span) override;

  static Clock SteadyClock();

 private:
  struct Running {
    std::size_t stage = 0;
    double work = 0, fraction = 0;
  };
  struct Stage {
    std::string name;
    ProgressCounts counts = {};
    std::size_t last_printed_done = 0;
    double last_printed_s = -1e9;
  };
  /// What is derived from counts at a moment; eta_s < 0 = not known.
  struct Estimate {
    double fraction = 0, rate_per_s = 0, eta_s = -1;
  };

  Stage& StageOf(const Task& task);
  ProgressCounts Sum() const;
  Estimate EstimateOf(const ProgressCounts& counts, double running_work, double now_s) const;
  double RunningWork(const Stage* stage) const;
  /// Of the whole run: fraction and time left.
  Estimate WholeRun(double now_s) const;
  std::string TotalLine(double now_s) const;
  std::string Line(const std::string& name, const ProgressCounts& counts, double running_work, double now_s) const;
  void Show(bool at_end);
  void ShowTerminal(double now_s);
  void ShowPlain(double now_s, bool at_end);
  void PrintJson(const char* event, const std::string& stage, const ProgressCounts& counts, double running_work,
                 const std::string& more);

  std::FILE* out_;
  ProgressStyle style_;
  Clock now_s_;
  ForecastSource forecast_;
  TimeModel model_;
  std::vector<Stage> stages_;  ///< in order of appearance
  std::map<std::string, std::size_t> stage_index_;
  std::map<TaskId, Running> running_;
  double first_start_s_ = 0;  ///< of any task
  bool has_started_ = false;
  double last_shown_s_ = -1e9;
  std::size_t lines_on_terminal_ = 0;
  bool finished_ = false;
};

}  // namespace rilievo::engine
