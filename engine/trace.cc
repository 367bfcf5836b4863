// Writes recorded spans in the Chrome trace-event format ("Trace Event Format", JSON object form).
#include "engine/trace.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <span>

#include "base/cpu.h"
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

/// Nine digits: enough for any count here, and the same text for the same number.
std::string Number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.9g", value);
  return text;
}

std::string NeedsJson(const std::vector<TaskId>& needs) {
  std::string text = "[";
  for (const TaskId need : needs) text += (text.size() > 1 ? "," : "") + std::to_string(need.value);
  return text + "]";
}

std::string KernelsJson(const std::vector<KernelUse>& kernels) {
  std::string text = "{";
  for (const KernelUse& use : kernels) {
    text += (text.size() > 1 ? "," : "") + Quoted(std::string(use.kernel.name)) + ":{\"arithmetic\":\"" +
            (use.kernel.arithmetic == KernelName::Arithmetic::kBytes ? "bytes" : "floats") +
            "\",\"multiply_adds\":" + Number(use.multiply_adds) + ",\"cpu_s\":" + Number(use.cpu_s) + "}";
  }
  return text + "}";
}

std::string CounterEvent(const char* name, double time_s, std::uint64_t bytes) {
  return std::string("{\"ph\":\"C\",\"name\":\"") + name + "\",\"pid\":1,\"tid\":0,\"ts\":" + Microseconds(time_s) +
         ",\"args\":{\"bytes\":" + std::to_string(bytes) + "}}";
}

}  // namespace

std::string ProcessorName() {
  std::ifstream info("/proc/cpuinfo");
  std::string name = "unknown processor";
  for (std::string line; std::getline(info, line);) {
    const auto colon = line.find(": ");
    if (!line.starts_with("model name") || colon == std::string::npos) continue;
    name = line.substr(colon + 2);
    break;
  }
  return name + ", " + std::string(ProcessorLevel());
}

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
  entry.units = task.units;
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
  text += ",\"cpu_s\":" + Number(span.cpu_s);
  if (entry.units.amount > 0)
    text += ",\"units\":" + Number(entry.units.amount) + ",\"unit\":" + Quoted(entry.units.name);
  if (!entry.needs.empty()) text += ",\"needs\":" + NeedsJson(entry.needs);
  if (!span.kernels.empty()) text += ",\"kernels\":" + KernelsJson(span.kernels);
  if (!entry.error.empty()) text += ",\"error\":" + Quoted(entry.error);
  return text + "}}";
}

std::string Trace::HelpersJson(const Entry& entry) const {
  std::string text;
  for (const HelperSpan& helper : entry.span.helpers) {
    if (helper.worker == entry.span.worker) continue;
    text += ",\n{\"ph\":\"X\",\"name\":" + Quoted("loop of " + entry.name) +
            ",\"cat\":\"loop\",\"pid\":1,\"tid\":" + std::to_string(helper.worker) +
            ",\"ts\":" + Microseconds(helper.start_s) +
            ",\"dur\":" + Microseconds(std::max(0.0, helper.end_s - helper.start_s)) +
            ",\"args\":{\"helps\":" + std::to_string(entry.span.task.value) + "}}";
  }
  return text;
}

std::string Trace::FactsJson() const {
  return "{\"format\":\"rilievo-trace\",\"version\":1,\"threads\":" + std::to_string(facts_.threads) +
         ",\"memory_bytes\":" + std::to_string(facts_.memory_bytes) +
         ",\"overhead_bytes\":" + std::to_string(facts_.overhead_bytes) + ",\"before_s\":" + Number(facts_.before_s) +
         ",\"processor\":" + Quoted(facts_.processor) +
         ",\"process_peak_bytes\":" + std::to_string(memory_ == nullptr ? 0 : PeakResidentBytes()) + "}";
}

std::string Trace::Json() const {
  std::string text = "{\"displayTimeUnit\":\"ms\",\"otherData\":" + FactsJson() + ",\"traceEvents\":[\n" +
                     NameEvent("process_name", 0, "rilievo");
  std::set<int> workers;
  for (const Entry& entry : entries_) {
    if (!entry.started || !entry.ended) continue;
    workers.insert(entry.span.worker);
    for (const HelperSpan& helper : entry.span.helpers) workers.insert(helper.worker);
  }
  for (const int worker : workers) text += ",\n" + NameEvent("thread_name", worker, "worker " + std::to_string(worker));
  for (const Entry& entry : entries_)
    if (entry.started && entry.ended) text += ",\n" + SpanJson(entry) + HelpersJson(entry);
  for (const LiveBytes& live : LiveBytesOverTime()) text += ",\n" + CounterEvent("live bytes", live.time_s, live.bytes);
  if (memory_ != nullptr)
    for (const MemorySample& sample : memory_->Samples())
      text += ",\n" + CounterEvent("resident bytes", sample.time_s, sample.bytes);
  return text + "\n]}\n";
}

void Trace::Write(const std::filesystem::path& path) const {
  const std::string text = Json();
  WriteFileDurably(path, std::as_bytes(std::span(text)));
}

}  // namespace rilievo::engine
