// Counting, estimating and printing of progress.
#include "engine/progress.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/units.h"

namespace rilievo::engine {
namespace {

constexpr double kTerminalInterval_s = 0.1;
constexpr double kPlainInterval_s = 2.0;
constexpr double kJsonStageInterval_s = 1.0;
/// Tasks that declare no work count as this much, so that a plan of them has a fraction too.
constexpr double kLeastWork = 1e-3;

double WorkOf(const Task& task) { return std::max(task.cost.work, kLeastWork); }

std::size_t TerminalWidth(std::FILE* out) {
  winsize size{};
  if (::ioctl(::fileno(out), TIOCGWINSZ, &size) == 0 && size.ws_col > 20) return size.ws_col;
  return 80;
}

const char* StateName(TaskState state) {
  switch (state) {
    case TaskState::kPending:
      return "pending";
    case TaskState::kRunning:
      return "running";
    case TaskState::kDone:
      return "done";
    case TaskState::kFailed:
      return "failed";
    case TaskState::kSkipped:
      return "skipped";
    case TaskState::kCancelled:
      return "cancelled";
  }
  return "unknown";
}

std::string Quoted(const std::string& text) {
  return nlohmann::json(text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string Format(const char* format, double value) {
  char text[48];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

void AddCount(std::string& list, std::size_t count, const char* what) {
  if (count == 0) return;
  list += list.empty() ? "" : ", ";
  list += std::to_string(count) + " " + what;
}

}  // namespace

Progress::Clock Progress::SteadyClock() {
  return [start = std::chrono::steady_clock::now()] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
}

Progress::Progress(std::FILE* out, ProgressStyle style, Clock now_s, ForecastSource forecast)
    : out_(out), style_(style), now_s_(std::move(now_s)), forecast_(std::move(forecast)) {
  if (style_ == ProgressStyle::kAuto)
    style_ = ::isatty(::fileno(out)) ? ProgressStyle::kTerminal : ProgressStyle::kPlain;
}

Progress::Stage& Progress::StageOf(const Task& task) {
  const auto [it, is_new] = stage_index_.try_emplace(task.stage, stages_.size());
  if (is_new) stages_.push_back({.name = task.stage});
  return stages_[it->second];
}

void Progress::OnTaskAdded(TaskId, const Task& task) {
  ProgressCounts& counts = StageOf(task).counts;
  ++counts.total;
  counts.total_work += WorkOf(task);
  model_.Add(task.stage, WorkOf(task));
}

void Progress::OnTaskStarted(TaskId id, const Task& task, int) {
  ProgressCounts& counts = StageOf(task).counts;
  const double now_s = now_s_();
  if (counts.first_start_s < 0) counts.first_start_s = now_s;
  if (!has_started_) first_start_s_ = now_s;
  has_started_ = true;
  model_.Start(id, task.stage, WorkOf(task), now_s);
  running_[id] = {stage_index_.at(task.stage), WorkOf(task), 0};
  Show(false);
}

void Progress::OnTaskProgress(TaskId id, const Task&, double fraction) {
  const auto it = running_.find(id);
  if (it == running_.end()) return;
  it->second.fraction = std::clamp(fraction, 0.0, 1.0);
  model_.SetFraction(id, fraction);
  Show(false);
}

void Progress::OnTaskFinished(TaskId id, const Task& task, const TaskOutcome& outcome, const TaskSpan& span) {
  Stage& stage = StageOf(task);
  ProgressCounts& counts = stage.counts;
  ++counts.done;
  counts.ended_work += WorkOf(task);
  counts.reused += outcome.reused;
  counts.failed += outcome.state == TaskState::kFailed;
  counts.skipped += outcome.state == TaskState::kSkipped;
  counts.cancelled += outcome.state == TaskState::kCancelled;
  counts.read_bytes += outcome.read_bytes;
  counts.written_bytes += outcome.written_bytes;
  counts.last_end_s = now_s_();
  const bool computed = outcome.state == TaskState::kDone && !outcome.reused;
  double helped_s = 0;
  for (const HelperSpan& helper : span.helpers) helped_s += helper.end_s - helper.start_s;
  model_.Finish(id, task.stage, WorkOf(task), computed, counts.last_end_s, helped_s, span.cpu_s);
  if (running_.erase(id) > 0 && computed) {
    ++counts.computed;
    counts.computed_work += WorkOf(task);
  }
  if (style_ == ProgressStyle::kJson) {
    std::string more = ",\"task\":" + Quoted(task.name) + ",\"state\":\"" + StateName(outcome.state) + "\"";
    if (!outcome.error.empty()) more += ",\"error\":" + Quoted(outcome.error);
    PrintJson("task", stage.name, counts, RunningWork(&stage), more);
  }
  Show(false);
}

ProgressCounts Progress::Sum() const {
  ProgressCounts sum;
  for (const Stage& stage : stages_) {
    const ProgressCounts& counts = stage.counts;
    sum.done += counts.done;
    sum.total += counts.total;
    sum.reused += counts.reused;
    sum.failed += counts.failed;
    sum.skipped += counts.skipped;
    sum.cancelled += counts.cancelled;
    sum.total_work += counts.total_work;
    sum.ended_work += counts.ended_work;
    sum.computed_work += counts.computed_work;
    sum.computed += counts.computed;
    sum.read_bytes += counts.read_bytes;
    sum.written_bytes += counts.written_bytes;
    const bool earlier =
        counts.first_start_s >= 0 && (sum.first_start_s < 0 || counts.first_start_s < sum.first_start_s);
    if (earlier) sum.first_start_s = counts.first_start_s;
    sum.last_end_s = std::max(sum.last_end_s, counts.last_end_s);
  }
  return sum;
}

double Progress::RunningWork(const Stage* stage) const {
  double work = 0;
  for (const auto& [id, running] : running_)
    if (stage == nullptr || &stages_[running.stage] == stage) work += running.work * running.fraction;
  return work;
}

Progress::Estimate Progress::EstimateOf(const ProgressCounts& counts, double running_work, double now_s) const {
  Estimate estimate;
  const bool complete = counts.done == counts.total;
  if (counts.total_work > 0)
    estimate.fraction = complete ? 1 : std::min(1.0, (counts.ended_work + running_work) / counts.total_work);
  if (complete) estimate.eta_s = 0;
  if (counts.first_start_s < 0) return estimate;
  const double elapsed_s = (complete ? counts.last_end_s : now_s) - counts.first_start_s;
  if (elapsed_s <= 0) return estimate;
  estimate.rate_per_s = static_cast<double>(counts.computed) / elapsed_s;
  const double work_done = counts.computed_work + running_work;
  if (!complete && work_done > 0)
    estimate.eta_s = std::max(0.0, counts.total_work - counts.ended_work - running_work) * elapsed_s / work_done;
  return estimate;
}

Progress::Estimate Progress::WholeRun(double now_s) const {
  const ProgressCounts sum = Sum();
  const RunForecast forecast = forecast_ ? forecast_() : RunForecast{};
  const bool more_to_come = std::any_of(forecast.stages.begin(), forecast.stages.end(),
                                        [](const StageForecast& stage) { return stage.more_work > 0; });
  Estimate estimate = EstimateOf(sum, RunningWork(nullptr), now_s);
  if (sum.done == sum.total && !more_to_come) return estimate;
  const TimeModel::Estimate whole = model_.At(now_s, forecast);
  estimate.fraction = whole.fraction;
  estimate.eta_s = whole.left_s;
  return estimate;
}

std::string Progress::TotalLine(double now_s) const {
  const Estimate whole = WholeRun(now_s);
  std::string line = Format("total %.0f %%", std::floor(100 * whole.fraction + 1e-6));
  if (whole.fraction < 1) line += "  ETA " + (whole.eta_s < 0 ? std::string("-") : FormatDuration(whole.eta_s));
  return line;
}

std::string Progress::Line(const std::string& name, const ProgressCounts& counts, double running_work,
                           double now_s) const {
  const Estimate estimate = EstimateOf(counts, running_work, now_s);
  std::string line = name;
  line.resize(std::max<std::size_t>(line.size() + 1, 14), ' ');
  line += std::to_string(counts.done) + "/" + std::to_string(counts.total) +
          Format("  %.0f %%", std::floor(100 * estimate.fraction));
  if (estimate.rate_per_s > 0) line += Format(estimate.rate_per_s < 10 ? "  %.2f/s" : "  %.0f/s", estimate.rate_per_s);
  if (counts.done < counts.total)
    line += "  ETA " + (estimate.eta_s < 0 ? std::string("-") : FormatDuration(estimate.eta_s));
  else if (counts.first_start_s >= 0)
    line += "  in " + FormatDuration(counts.last_end_s - counts.first_start_s);
  std::string list;
  AddCount(list, counts.reused, "reused");
  AddCount(list, counts.failed, "failed");
  AddCount(list, counts.skipped, "skipped");
  AddCount(list, counts.cancelled, "cancelled");
  return list.empty() ? line : line + "  (" + list + ")";
}

void Progress::Show(bool at_end) {
  const double now_s = now_s_();
  if (style_ == ProgressStyle::kTerminal) {
    if (!at_end && now_s - last_shown_s_ < kTerminalInterval_s) return;
    last_shown_s_ = now_s;
    ShowTerminal(now_s);
  } else if (style_ == ProgressStyle::kPlain) {
    if (last_shown_s_ < -1e8) last_shown_s_ = now_s;  // the first lines come when there is something to say
    if (!at_end && now_s - last_shown_s_ < kPlainInterval_s) return;
    last_shown_s_ = now_s;
    ShowPlain(now_s, at_end);
  } else if (style_ == ProgressStyle::kJson) {
    for (Stage& stage : stages_) {
      const bool changed = stage.counts.done != stage.last_printed_done;
      const bool due = now_s - stage.last_printed_s >= kJsonStageInterval_s;
      if (stage.counts.first_start_s < 0 || (at_end ? !changed : !due)) continue;
      stage.last_printed_s = now_s;
      stage.last_printed_done = stage.counts.done;
      PrintJson("stage", stage.name, stage.counts, RunningWork(&stage), "");
    }
  }
}

void Progress::ShowTerminal(double now_s) {
  std::string text = lines_on_terminal_ > 0 ? "\x1b[" + std::to_string(lines_on_terminal_) + "A" : "";
  const std::size_t width = TerminalWidth(out_) - 1;  // a line that wraps could not be rewritten
  const auto add = [&](std::string line) {
    if (line.size() > width) line.resize(width);
    text += "\r" + line + "\x1b[K\n";
  };
  for (const Stage& stage : stages_) add(Line(stage.name, stage.counts, RunningWork(&stage), now_s));
  const ProgressCounts sum = Sum();
  add("total         " + std::to_string(sum.done) + "/" + std::to_string(sum.total) + TotalLine(now_s).substr(5));
  lines_on_terminal_ = stages_.size() + 1;
  std::fputs(text.c_str(), out_);
  std::fflush(out_);
}

void Progress::ShowPlain(double now_s, bool at_end) {
  const std::string total = TotalLine(now_s);
  for (Stage& stage : stages_) {
    const bool is_last = stage.counts.done == stage.counts.total;
    if (stage.counts.first_start_s < 0 && !at_end) continue;
    const bool was_last = stage.last_printed_done == stage.counts.done && stage.last_printed_s >= 0;
    if (was_last && (is_last || at_end)) continue;
    stage.last_printed_s = now_s;
    stage.last_printed_done = stage.counts.done;
    const std::string line = Line(stage.name, stage.counts, RunningWork(&stage), now_s);
    std::fprintf(out_, "%s  %s\n", line.c_str(), total.c_str());
  }
  std::fflush(out_);
}

void Progress::PrintJson(const char* event, const std::string& stage, const ProgressCounts& counts, double running_work,
                         const std::string& more) {
  const double now_s = now_s_();
  const Estimate estimate = EstimateOf(counts, running_work, now_s), whole = WholeRun(now_s);
  std::string line = std::string("{\"event\":\"") + event + "\",\"stage\":" + Quoted(stage) +
                     ",\"done\":" + std::to_string(counts.done) + ",\"total\":" + std::to_string(counts.total) +
                     ",\"reused\":" + std::to_string(counts.reused) + ",\"failed\":" + std::to_string(counts.failed) +
                     Format(",\"rate_per_s\":%.6g", estimate.rate_per_s);
  line += estimate.eta_s < 0 ? ",\"eta_s\":null" : Format(",\"eta_s\":%.6g", estimate.eta_s);
  line += Format(",\"fraction\":%.6g", estimate.fraction) + ",\"read_bytes\":" + std::to_string(counts.read_bytes) +
          ",\"written_bytes\":" + std::to_string(counts.written_bytes) +
          Format(",\"elapsed_s\":%.6g", now_s - first_start_s_) + Format(",\"total_fraction\":%.6g", whole.fraction);
  line += (whole.eta_s < 0 ? ",\"total_eta_s\":null" : Format(",\"total_eta_s\":%.6g", whole.eta_s)) + more + "}\n";
  std::fputs(line.c_str(), out_);
  std::fflush(out_);
}

void Progress::Finish() {
  if (finished_) return;
  finished_ = true;
  if (style_ == ProgressStyle::kQuiet) return;
  if (!stages_.empty()) Show(true);
  if (style_ == ProgressStyle::kJson) PrintJson("end", "", Sum(), 0, "");
}

}  // namespace rilievo::engine
