// Runs a task's body and puts its end into words.
#include "engine/task_run.h"

#include <algorithm>
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

}  // namespace

TaskOutcome TaskRun::Execute(const Task& task) noexcept {
  TaskOutcome outcome = Guarded(task.name, [&] { task.run(*this); });
  outcome.reused = outcome.state == TaskState::kDone && reused_.load(std::memory_order_relaxed);
  outcome.read_bytes = read_bytes();
  outcome.written_bytes = written_bytes();
  return outcome;
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
