// Plan: the append-only list of tasks.
#include "engine/plan.h"

#include <utility>

#include "base/check.h"

namespace rilievo::engine {

TaskId Plan::Add(Task task) {
  const TaskId id(static_cast<std::uint32_t>(tasks_.size()));
  RILIEVO_CHECK(id.IsValid());
  RILIEVO_CHECK(task.run != nullptr);
  for (const TaskId need : task.needs) RILIEVO_CHECK(need < id);
  RILIEVO_CHECK(names_.insert(task.name).second);
  tasks_.push_back(std::move(task));
  return id;
}

std::vector<TaskId> Plan::FindByStage(const std::string& stage) const {
  std::vector<TaskId> found;
  for (std::uint32_t i = 0; i < tasks_.size(); ++i)
    if (tasks_[i].stage == stage) found.emplace_back(i);
  return found;
}

}  // namespace rilievo::engine
