// A plan: tasks with their needs and costs, as data. Executors run it.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <unordered_set>
#include <vector>

#include "base/ids.h"
#include "base/run_context.h"
#include "base/task_cost.h"

namespace rilievo::engine {

class Plan;

/// What a running task sees: the RunContext of stages, byte counters for the trace, and growth of the plan.
class TaskContext : public RunContext {
 public:
  /// Bytes read from and written to disk by this task; they appear in its trace span.
  virtual void CountBytes(std::uint64_t read_bytes, std::uint64_t written_bytes) = 0;
  /// Says that the result was already there and nothing was computed; shown by progress, trace and report.
  virtual void MarkReused() = 0;
  /// Adds tasks once this one has finished: `grow` is called by the executor with the plan, must be a pure function of
  /// this task's result, and may name any existing task or tasks it adds itself as needs.
  virtual void Grow(std::function<void(Plan&)> grow) = 0;
};

/// What a task works through, for rates: 12 "Mpx", 4 "pairs". All tasks of a stage have one unit.
struct TaskUnits {
  double amount = 0;
  const char* name = "";
};

struct Task {
  std::string name;           ///< unique in the plan
  std::string stage;          ///< progress and trace group by it
  std::vector<TaskId> needs;  ///< must exist already: a plan has no cycles by construction
  TaskCost cost;
  std::uint64_t retained_bytes = 0;  ///< memory its result keeps until the tasks that need it are done
  TaskUnits units = {};
  std::string memory_hint;  ///< what to change when cost.peak_bytes can never fit, e.g. "raise --memory to 3.1 GiB"
  std::function<void(TaskContext&)> run;
};

/// Append-only list of tasks; a task's id is its index. Lower ids are admitted first.
class Plan {
 public:
  /// A name given twice, a need that does not exist yet or an empty `run` is a caller's bug (check). Amortised
  /// O(needs).
  TaskId Add(Task task);
  std::size_t size() const { return tasks_.size(); }
  const Task& task(TaskId id) const { return tasks_.at(id.value); }
  const std::deque<Task>& tasks() const { return tasks_; }
  /// Ids in ascending order; linear in the size of the plan.
  std::vector<TaskId> FindByStage(const std::string& stage) const;

 private:
  std::deque<Task> tasks_;  ///< a deque, so that running tasks stay where they are while the plan grows
  std::unordered_set<std::string> names_;
};

}  // namespace rilievo::engine
