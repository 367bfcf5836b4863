// The admission rules, driven by a simulated machine that ends its running tasks in any order.
#include "engine/memory_budget.h"

#include <gtest/gtest.h>

#include <set>

#include "base/error.h"
#include "base/rng.h"
#include "engine/ready_queue.h"

namespace rilievo::engine {
namespace {

TaskId Add(Plan& plan, std::vector<TaskId> needs, std::uint64_t peak_bytes, std::uint64_t retained_bytes = 0) {
  Task task;
  task.name = std::to_string(plan.size());
  task.needs = std::move(needs);
  task.cost.peak_bytes = peak_bytes;
  task.retained_bytes = retained_bytes;
  task.run = [](TaskContext&) {};
  return plan.Add(std::move(task));
}

TEST(MemoryBudget, ChargesPeakWhileRunningAndTheResultUntilItsLastConsumerEnds) {
  Plan plan;
  const auto a = Add(plan, {}, 30, 10), b = Add(plan, {a}, 5), c = Add(plan, {a, a}, 5);
  MemoryBudget budget(100);
  budget.Register(plan);
  EXPECT_TRUE(budget.TryAdmit(a));
  EXPECT_EQ(budget.live_bytes(), 30u);
  budget.Finish(plan, a, true);
  EXPECT_EQ(budget.live_bytes(), 10u);
  EXPECT_TRUE(budget.TryAdmit(b));
  EXPECT_TRUE(budget.TryAdmit(c));
  EXPECT_EQ(budget.live_bytes(), 20u);
  budget.Finish(plan, b, true);
  EXPECT_EQ(budget.live_bytes(), 15u);
  const auto d = Add(plan, {a}, 1);  // grown by c
  budget.Register(plan);
  budget.Finish(plan, c, true);
  EXPECT_EQ(budget.live_bytes(), 10u);
  budget.Finish(plan, d, false);  // skipped: never admitted
  EXPECT_EQ(budget.live_bytes(), 0u);
  EXPECT_EQ(budget.peak_live_bytes(), 30u);
}

TEST(MemoryBudget, AFailedTaskKeepsNothing) {
  Plan plan;
  const auto a = Add(plan, {}, 30, 10);
  Add(plan, {a}, 5);
  MemoryBudget budget(100);
  budget.Register(plan);
  EXPECT_TRUE(budget.TryAdmit(a));
  budget.Finish(plan, a, false);
  EXPECT_EQ(budget.live_bytes(), 0u);
}

TEST(MemoryBudget, NobodyDelaysTheFirstInLine) {
  Plan plan;
  const auto a = Add(plan, {}, 60), large = Add(plan, {}, 80), c = Add(plan, {}, 25), d = Add(plan, {}, 20),
             e = Add(plan, {}, 1);
  MemoryBudget budget(100);
  budget.Register(plan);
  EXPECT_TRUE(budget.TryAdmit(a));
  EXPECT_FALSE(budget.TryAdmit(large));
  EXPECT_FALSE(budget.TryAdmit(c));  // fits now, but beside it the large one would not
  EXPECT_TRUE(budget.TryAdmit(d));
  EXPECT_FALSE(budget.TryAdmit(e));  // 80 + 20 is all there is
  budget.Finish(plan, a, true);
  EXPECT_TRUE(budget.TryAdmit(large));
}

TEST(MemoryBudget, UnlimitedAdmitsEverything) {
  Plan plan;
  MemoryBudget budget(0);
  for (int i = 0; i < 10; ++i) Add(plan, {}, std::uint64_t{1} << 55, std::uint64_t{1} << 54);
  budget.Register(plan);
  budget.RefuseWhatNeverFits(plan);
  for (std::uint32_t i = 0; i < 10; ++i) EXPECT_TRUE(budget.TryAdmit(TaskId(i)));
}

/// Runs a plan on `threads` simulated workers that end in random order and checks the laws at every step.
class Machine {
 public:
  Machine(Plan& plan, std::uint64_t budget_bytes, std::size_t threads, std::uint64_t seed)
      : plan_(plan), budget_bytes_(budget_bytes), threads_(threads), budget_(budget_bytes), rng_(seed) {
    budget_.Register(plan);
    budget_.RefuseWhatNeverFits(plan);
    for (std::uint32_t i = 0; i < plan.size(); ++i) {
      any_retained_ |= plan.task(TaskId(i)).retained_bytes > 0;
      needs_left_.push_back(plan.task(TaskId(i)).needs.size());
      consumers_left_.push_back(0);
      for (const TaskId need : plan.task(TaskId(i)).needs) ++consumers_left_[need.value];
      if (needs_left_.back() == 0) ready_.Push(TaskId(i));
    }
  }

  void Run() {
    while (finished_.size() < plan_.size()) {
      Admit();
      ASSERT_FALSE(running_.empty()) << "nothing runs and nothing is admitted: locked up after " << finished_.size();
      ASSERT_LE(OwnLiveBytes(), budget_bytes_);
      ASSERT_EQ(OwnLiveBytes(), budget_.live_bytes());
      auto it = running_.begin();
      std::advance(it, rng_.Below(static_cast<std::uint32_t>(running_.size())));
      const TaskId id = *it;
      running_.erase(it);
      waited_for_.erase(id);
      End(id);
    }
    EXPECT_EQ(budget_.live_bytes(), 0u);
  }
  std::size_t most_running() const { return most_running_; }

 private:
  void Admit() {
    ready_.Begin();
    bool someone_refused = false;
    while (running_.size() < threads_) {
      const auto id = ready_.Next();
      if (!id) break;
      if (budget_.TryAdmit(*id)) {
        running_.insert(*id);
        most_running_ = std::max(most_running_, running_.size());
        if (first_in_line_ == *id) first_in_line_ = TaskId();
        if (*id < first_in_line_) waited_for_.insert(*id);  // lower ones go first
        continue;
      }
      ready_.Refuse(*id);
      if (someone_refused) continue;
      someone_refused = true;
      if (first_in_line_ == *id) {
        // Results that stay are no matter of who runs; without them the line must move when the earlier ones have
        // ended.
        ASSERT_TRUE(any_retained_ || !waited_for_.empty()) << "task " << id->value << " was overtaken";
      } else {
        first_in_line_ = *id;
        waited_for_ = running_;
      }
    }
  }
  void End(TaskId id) {
    finished_.insert(id);
    budget_.Finish(plan_, id, true);
    for (const TaskId need : plan_.task(id).needs) --consumers_left_[need.value];
    for (std::uint32_t i = id.value; i < plan_.size(); ++i)
      for (const TaskId need : plan_.task(TaskId(i)).needs)
        if (need == id && --needs_left_[i] == 0) ready_.Push(TaskId(i));
  }
  std::uint64_t OwnLiveBytes() {
    std::uint64_t live = 0;
    for (const TaskId id : running_) live += std::max(plan_.task(id).cost.peak_bytes, plan_.task(id).retained_bytes);
    for (const TaskId id : finished_)
      if (consumers_left_[id.value] > 0) live += plan_.task(id).retained_bytes;
    return live;
  }

  Plan& plan_;
  std::uint64_t budget_bytes_;
  std::size_t threads_;
  MemoryBudget budget_;
  Rng rng_;
  ReadyQueue ready_;
  std::vector<std::size_t> needs_left_, consumers_left_;
  std::set<TaskId> running_, finished_, waited_for_;
  TaskId first_in_line_;
  bool any_retained_ = false;
  std::size_t most_running_ = 0;
};

Plan RandomPlan(Rng& rng, std::uint32_t tasks, std::uint32_t most_bytes, std::uint32_t most_retained_bytes) {
  Plan plan;
  for (std::uint32_t i = 0; i < tasks; ++i) {
    std::vector<TaskId> needs;
    for (std::uint32_t k = rng.Below(4); k > 0 && i > 0; --k) needs.emplace_back(rng.Below(i));
    Add(plan, needs, rng.Below(most_bytes + 1), rng.Below(most_retained_bytes + 1));
  }
  return plan;
}

TEST(MemoryBudget, TheLineMovesAndTheBudgetHoldsWhateverEndsFirst) {
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    Rng rng(seed);
    Plan plan = RandomPlan(rng, 100, 100, 0);
    Machine machine(plan, 100 + rng.Below(100), 1 + rng.Below(8), seed);
    machine.Run();
    ASSERT_FALSE(HasFatalFailure()) << "seed " << seed;
  }
}

TEST(MemoryBudget, KeptResultsNeverLockARunThatFitsInIdOrder) {
  std::size_t parallel = 0;
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    Rng rng(seed);
    Plan plan = RandomPlan(rng, 100, 60, 40);
    std::uint64_t budget = 60;  // the least that id order needs
    for (bool fits = false; !fits; budget += !fits) {
      MemoryBudget trial(budget);
      trial.Register(plan);
      try {
        trial.RefuseWhatNeverFits(plan);
        fits = true;
      } catch (const Error&) {
      }
    }
    Machine machine(plan, budget + (seed % 3) * 100, 4, seed);
    machine.Run();
    ASSERT_FALSE(HasFatalFailure()) << "seed " << seed << ", budget " << budget;
    parallel += machine.most_running() > 1;
  }
  EXPECT_GT(parallel, 250u);
}

}  // namespace
}  // namespace rilievo::engine
