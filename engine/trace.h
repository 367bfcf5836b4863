// Records a run as a Chrome trace: a span per task, for Perfetto and chrome://tracing.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "engine/executor.h"
#include "engine/memory_curve.h"

namespace rilievo::engine {

/// What a trace says about its run as a whole.
struct RunFacts {
  int threads = 0;
  std::uint64_t memory_bytes = 0;    ///< what the tasks were allowed to hold; 0 = unlimited
  std::uint64_t overhead_bytes = 0;  ///< what the process was to hold beside them
  double before_s = 0;               ///< from the program's start to the run's: reading of headers and digests
  std::string processor;             ///< model and level (ProcessorName)
};

/// "AMD EPYC 7B13, avx2": two runs of one name can be compared with one measured peak.
std::string ProcessorName();

/// Holds the run in memory (about 150 bytes a task) and gives it out at the end; docs/formats/trace.md describes the
/// file. What has been recorded until then is a whole file too, so a cancelled run has its trace.
class Trace : public Observer {
 public:
  Trace() = default;
  /// `memory` may be null; it outlives the trace.
  Trace(RunFacts facts, const MemoryCurve* memory) : facts_(std::move(facts)), memory_(memory) {}

  void OnTaskAdded(TaskId id, const Task& task) override;
  void OnTaskStarted(TaskId id, const Task& task, int worker) override;
  void OnTaskFinished(TaskId id, const Task& task, const TaskOutcome& outcome, const TaskSpan& span) override;

  std::string Json() const;
  /// Durable write of Json(). Throws Error(kDiskFull / kIo).
  void Write(const std::filesystem::path& path) const;

 private:
  struct Entry {
    std::string name;
    std::uint32_t stage = 0;
    std::vector<TaskId> needs;
    std::uint64_t peak_bytes = 0, retained_bytes = 0;
    TaskUnits units;
    bool started = false, ended = false;
    TaskState state = TaskState::kPending;
    std::string error;
    TaskSpan span;
  };
  /// Charged bytes from `time_s` on.
  struct LiveBytes {
    double time_s = 0;
    std::uint64_t bytes = 0;
  };
  std::vector<LiveBytes> LiveBytesOverTime() const;
  std::string FactsJson() const;
  std::string SpanJson(const Entry& entry) const;
  std::string HelpersJson(const Entry& entry) const;

  RunFacts facts_;
  const MemoryCurve* memory_ = nullptr;
  std::vector<std::string> stages_;
  std::vector<Entry> entries_;  ///< by task id
};

}  // namespace rilievo::engine
