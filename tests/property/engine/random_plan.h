// Random plans whose outcome is known without any executor: a third witness beside the two executors.
#pragma once

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "base/rng.h"
#include "engine/executor.h"

namespace rilievo::engine::testing_support {

/// Everything about a task of a random plan follows from the seed and its name. Grown tasks are compared by name,
/// because their ids follow the order in which their growers ended.
struct RandomPlanOptions {
  std::uint64_t seed = 0;
  int tasks = 60;
  double failing = 0;            ///< share of tasks that throw
  double growing = 0;            ///< share of tasks that add one to three others
  std::uint64_t most_bytes = 0;  ///< peak_bytes are drawn from [0, most_bytes]
  std::uint64_t most_retained_bytes = 0;
};

struct Result {
  TaskState state = TaskState::kPending;
  std::uint64_t value = 0;
  friend bool operator==(const Result&, const Result&) = default;
};
using Results = std::map<std::string, Result>;

struct TaskRecipe {
  std::string name;
  std::vector<std::string> needs;
  bool fails = false;
  int grows = 0;
  TaskCost cost;
  std::uint64_t retained_bytes = 0;
};

inline std::uint64_t HashOf(const std::string& text) {
  std::uint64_t hash = 1;
  for (const char c : text) hash = Mix64(hash ^ static_cast<unsigned char>(c));
  return hash;
}

class RandomPlan {
 public:
  explicit RandomPlan(const RandomPlanOptions& options) : options_(options) {}

  /// The i-th task of the beginning.
  TaskRecipe Initial(int i) const {
    std::vector<std::string> pool;
    for (int k = std::max(0, i - 12); k < i; ++k) pool.push_back(Name(k));
    return Recipe(Name(i), pool, 0.25, {});
  }
  /// The k-th task that `grower` adds: needs its grower, perhaps its elder sister and any task of the beginning.
  TaskRecipe Grown(const std::string& grower, int k) const {
    std::vector<std::string> pool;
    for (int i = 0; i < options_.tasks; i += 7) pool.push_back(Name(i));
    if (k > 0) pool.push_back(grower + "." + std::to_string(k - 1));
    return Recipe(grower + "." + std::to_string(k), pool, 0.15, {grower});
  }
  const RandomPlanOptions& options() const { return options_; }

 private:
  static std::string Name(int i) { return "t" + std::to_string(i); }
  TaskRecipe Recipe(std::string name, const std::vector<std::string>& pool, double share,
                    std::vector<std::string> needs) const {
    Rng rng(SeedFor(options_.seed, HashOf(name)));
    TaskRecipe recipe;
    for (const auto& candidate : pool)
      if (rng.Uniform() < share) needs.push_back(candidate);
    recipe.needs = std::move(needs);
    recipe.fails = rng.Uniform() < options_.failing;
    const auto depth = std::count(name.begin(), name.end(), '.');
    if (rng.Uniform() < options_.growing && depth < 3) recipe.grows = 1 + static_cast<int>(rng.Below(3));
    recipe.cost.peak_bytes = options_.most_bytes > 0 ? rng.Next() % (options_.most_bytes + 1) : 0;
    recipe.retained_bytes = options_.most_retained_bytes > 0 ? rng.Next() % (options_.most_retained_bytes + 1) : 0;
    recipe.cost.peak_bytes = std::max(recipe.cost.peak_bytes, recipe.retained_bytes);
    recipe.name = std::move(name);
    return recipe;
  }
  RandomPlanOptions options_;
};

inline std::uint64_t ValueOf(const TaskRecipe& recipe, const Results& results) {
  std::uint64_t value = HashOf(recipe.name);
  for (const auto& need : recipe.needs) value = Mix64(value ^ results.at(need).value);
  return value;
}

/// The truth, by plain recursion: growth may need tasks of the beginning, so these come first.
inline Results Expected(const RandomPlan& random) {
  Results results;
  const auto settle = [&](const TaskRecipe& recipe) {
    Result result{TaskState::kDone, 0};
    for (const auto& need : recipe.needs)
      if (results.at(need).state != TaskState::kDone) result.state = TaskState::kSkipped;
    if (result.state == TaskState::kDone && recipe.fails) result.state = TaskState::kFailed;
    if (result.state == TaskState::kDone) result.value = ValueOf(recipe, results);
    results[recipe.name] = result;
  };
  std::vector<TaskRecipe> initial;
  for (int i = 0; i < random.options().tasks; ++i) settle(initial.emplace_back(random.Initial(i)));
  const std::function<void(const TaskRecipe&)> grow = [&](const TaskRecipe& grower) {
    if (results.at(grower.name).state != TaskState::kDone) return;
    std::vector<TaskRecipe> grown;
    for (int k = 0; k < grower.grows; ++k) settle(grown.emplace_back(random.Grown(grower.name, k)));
    for (const auto& task : grown) grow(task);
  };
  for (const auto& task : initial) grow(task);
  return results;
}

/// Turns recipes into tasks that compute their value from the values of their needs.
class PlanRun {
 public:
  using Hook = std::function<void(const TaskRecipe&, TaskContext&)>;
  explicit PlanRun(RandomPlan random, Hook inside = {}) : random_(std::move(random)), inside_(std::move(inside)) {}

  Results Run(Executor& executor, const ExecutionOptions& options) {
    Plan plan;
    for (int i = 0; i < random_.options().tasks; ++i) Add(plan, random_.Initial(i));
    report_ = executor.Run(plan, options);
    Results results;
    for (std::uint32_t i = 0; i < plan.size(); ++i) {
      const std::string& name = plan.task(TaskId(i)).name;
      results[name] = {report_.outcomes[i].state, values_.contains(name) ? values_.at(name).value : 0};
    }
    return results;
  }
  const ExecutionReport& report() const { return report_; }

 private:
  void Add(Plan& plan, const TaskRecipe& recipe) {
    Task task;
    task.name = recipe.name;
    task.stage = "random";
    for (const auto& need : recipe.needs) task.needs.push_back(ids_.at(need));
    task.cost = recipe.cost;
    task.retained_bytes = recipe.retained_bytes;
    task.run = [this, recipe](TaskContext& context) { Body(recipe, context); };
    ids_[recipe.name] = plan.Add(std::move(task));
  }
  void Body(const TaskRecipe& recipe, TaskContext& context) {
    if (inside_) inside_(recipe, context);
    if (recipe.fails) throw std::runtime_error("as planned");
    {
      const std::lock_guard lock(mutex_);
      values_[recipe.name] = {TaskState::kDone, ValueOf(recipe, values_)};
    }
    if (recipe.grows > 0) {
      context.Grow([this, recipe](Plan& plan) {
        for (int k = 0; k < recipe.grows; ++k) Add(plan, random_.Grown(recipe.name, k));
      });
    }
  }

  RandomPlan random_;
  Hook inside_;
  std::mutex mutex_;
  Results values_;
  std::map<std::string, TaskId> ids_;  ///< touched by the executor's scheduling only
  ExecutionReport report_;
};

}  // namespace rilievo::engine::testing_support
