// Writes recorded spans in the Chrome trace-event format ("Trace Event Format", JSON object form).
#include "engine/trace.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <span>

#include "engine/artifact_store.h"

namespace rilievo::engine {
namespace {

std::string Quoted(const std::string& text) {
  return nlohmann::json(text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string Microseconds(double seconds_s) {
  char text[40];
  std::snprintf(text, sizeof text, "%.3f", seconds_s * 1e6);
  return text;
}

std::string NameEvent(const char* what, int thread, const std::string& name) {
  return std::string("{\"ph\":\"M\",\"name\":\"") + what + "\",\"pid\":1,\"tid\":" + std::to_string(thread) +
         ",\"args\":{\"name\":" + Quoted(name) + "}}";
}

const char* StateName(TaskState state) {
  switch (state) {
    case TaskState::kDone:
      return "done";
    case TaskState::kFailed:
      return "failed";
    case TaskState::kCancelled:
      return "cancelled";
    default:
      return "unfinished";
  }
}

}  // namespace

void Trace::OnTaskAdded(TaskId id, const Task& task) {
  entries_.resize(std::max<std::size_t>(entries_.size(), id.value + std::size_t{1}));
  Entry& entry = entries_[id.value];
  entry.name = task.name;
  const auto found = std::find(stages_.begin(), stages_.end(), task.stage);
  entry.stage = static_cast<std::uint32_t>(found - stages_.begin());
  if (found == stages_.end()) stages_.push_back(task.stage);
  entry.needs = task.needs;
  entry.peak_bytes = task.cost.peak_bytes;
  entry.retained_bytes = task.retained_bytes;
}

void Trace::OnTaskStarted(TaskId id, const Task&, int) { entries_[id.value].started = true; }

void Trace::OnTaskFinished(TaskId id, const Task&, const TaskOutcome& outcome, const TaskSpan& span) {
  Entry& entry = entries_[id.value];
  entry.ended = true;
  entry.state = outcome.state;
  entry.error = outcome.error;
  entry.span = span;
}

std::vector<Trace::LiveBytes> Trace::LiveBytesOverTime() const {
  std::vector<double> released_s(entries_.size(), -1);  // when the last task that needs it ended
  double last_s = 0;
  for (const Entry& entry : entries_) {
    if (entry.started && entry.ended) last_s = std::max(last_s, entry.span.end_s);
    for (const TaskId need : entry.needs)
      released_s[need.value] = std::max(released_s[need.value], entry.started && entry.ended ? entry.span.end_s : -1);
  }
  struct Change {
    double time_s;
    std::int64_t bytes;
  };
  std::vector<Change> changes;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    const Entry& entry = entries_[i];
    const auto charge = static_cast<std::int64_t>(std::max(entry.peak_bytes, entry.retained_bytes));
    const auto kept = static_cast<std::int64_t>(entry.retained_bytes);
    if (!entry.started || !entry.ended || charge == 0) continue;
    changes.push_back({entry.span.start_s, charge});
    changes.push_back({entry.span.end_s, -charge});
    if (entry.state != TaskState::kDone || released_s[i] < entry.span.end_s || kept == 0) continue;
    changes.push_back({entry.span.end_s, kept});
    changes.push_back({released_s[i], -kept});
  }
  std::stable_sort(changes.begin(), changes.end(), [](const Change& a, const Change& b) {
    return a.time_s != b.time_s ? a.time_s < b.time_s : a.bytes < b.bytes;
  });
  std::vector<LiveBytes> over_time;
  std::int64_t live = 0;
  for (const Change& change : changes) {
    live += change.bytes;
    if (over_time.empty() || over_time.back().time_s != change.time_s) over_time.push_back({change.time_s, 0});
    over_time.back().bytes = static_cast<std::uint64_t>(std::max<std::int64_t>(live, 0));
  }
  return over_time;
}

std::string Trace::SpanJson(const Entry& entry) const {
  const TaskSpan& span = entry.span;
  std::string text = "{\"ph\":\"X\",\"name\":" + Quoted(entry.name) + ",\"cat\":" + Quoted(stages_[entry.stage]) +
                     ",\"pid\":1,\"tid\":" + std::to_string(span.worker) + ",\"ts\":" + Microseconds(span.start_s) +
                     ",\"dur\":" + Microseconds(std::max(0.0, span.end_s - span.start_s));
  text += ",\"args\":{\"stage\":" + Quoted(stages_[entry.stage]) + ",\"task\":" + std::to_string(span.task.value) +
          ",\"state\":\"" + StateName(entry.state) + "\",\"reused\":" + (span.reused ? "true" : "false") +
          ",\"read_bytes\":" + std::to_string(span.read_bytes) +
          ",\"written_bytes\":" + std::to_string(span.written_bytes) +
          ",\"peak_bytes\":" + std::to_string(entry.peak_bytes) +
          ",\"retained_bytes\":" + std::to_string(entry.retained_bytes);
  if (!entry.error.empty()) text += ",\"error\":" + Quoted(entry.error);
  return text + "}}";
}

std::string Trace::Json() const {
  std::string text = "{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n" + NameEvent("process_name", 0, "rilievo");
  std::set<int> workers;
  for (const Entry& entry : entries_)
    if (entry.started && entry.ended) workers.insert(entry.span.worker);
  for (const int worker : workers) text += ",\n" + NameEvent("thread_name", worker, "worker " + std::to_string(worker));
  for (const Entry& entry : entries_)
    if (entry.started && entry.ended) text += ",\n" + SpanJson(entry);
  for (const LiveBytes& live : LiveBytesOverTime()) {
    text += ",\n{\"ph\":\"C\",\"name\":\"live bytes\",\"pid\":1,\"tid\":0,\"ts\":" + Microseconds(live.time_s) +
            ",\"args\":{\"bytes\":" + std::to_string(live.bytes) + "}}";
  }
  return text + "\n]}\n";
}

void Trace::Write(const std::filesystem::path& path) const {
  const std::string text = Json();
  WriteFileDurably(path, std::as_bytes(std::span(text)));
}

}  // namespace rilievo::engine
