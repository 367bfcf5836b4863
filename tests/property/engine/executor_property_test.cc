// Laws of executors over random plans: equal outcomes, bounded memory, overlap, no starvation, isolation.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "base/error.h"
#include "engine/executor.h"
#include "tests/property/engine/random_plan.h"

namespace rilievo::engine {
namespace {

using testing_support::Expected;
using testing_support::PlanRun;
using testing_support::RandomPlan;
using testing_support::RandomPlanOptions;
using testing_support::TaskRecipe;

Task MakeTask(std::string name, std::vector<TaskId> needs, std::uint64_t peak_bytes,
              std::function<void(TaskContext&)> run) {
  Task task;
  task.name = std::move(name);
  task.stage = "test";
  task.needs = std::move(needs);
  task.cost.peak_bytes = peak_bytes;
  task.run = std::move(run);
  return task;
}

/// Notices when it is told of two things at once, and of things in a wrong order.
class StrictObserver : public Observer {
 public:
  void OnTaskAdded(TaskId id, const Task&) override {
    const Inside inside(*this);
    wrong_ += id.value != added_++;
  }
  void OnTaskStarted(TaskId id, const Task&, int worker) override {
    const Inside inside(*this);
    started_[id] = worker;
  }
  void OnTaskProgress(TaskId id, const Task&, double fraction) override {
    const Inside inside(*this);
    wrong_ += !started_.contains(id) || finished_.contains(id) || fraction < 0 || fraction > 1;
  }
  void OnTaskFinished(TaskId id, const Task& task, const TaskOutcome& outcome, const TaskSpan& span) override {
    const Inside inside(*this);
    const bool ran = outcome.state == TaskState::kDone || outcome.state == TaskState::kFailed;
    wrong_ += ran != started_.contains(id) || span.end_s < span.start_s || !(span.task == id);
    if (ran) wrong_ += started_.at(id) != span.worker;
    for (const TaskId need : task.needs) wrong_ += ran && !finished_.contains(need);
    wrong_ += !finished_.emplace(id, outcome.state).second;
  }
  int wrong() const { return wrong_; }
  std::size_t finished() const { return finished_.size(); }

 private:
  struct Inside {
    explicit Inside(StrictObserver& observer) : observer_(observer) {
      observer_.wrong_ += observer_.inside_.fetch_add(1);
    }
    ~Inside() { observer_.inside_.fetch_sub(1); }
    StrictObserver& observer_;
  };
  std::atomic<int> inside_{0}, wrong_{0};
  std::uint32_t added_ = 0;
  std::map<TaskId, int> started_;
  std::map<TaskId, TaskState> finished_;
};

TEST(ExecutorProperty, RandomPlansEndAlikeEverywhere) {
  std::size_t failed = 0, skipped = 0, grown = 0;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    RandomPlanOptions options{.seed = seed, .tasks = 80, .most_bytes = seed % 2 == 0 ? 0u : 100u};
    options.failing = seed % 3 == 0 ? 0 : 0.05;
    options.growing = seed % 4 == 0 ? 0 : 0.3;
    const RandomPlan random(options);
    const auto expected = Expected(random);
    for (const int threads : {0, 1, 2, 4}) {
      const auto executor = threads == 0 ? MakeSerialExecutor() : MakeFlowExecutor();
      StrictObserver observer;
      ExecutionOptions run_options{.threads = std::max(threads, 1), .memory_bytes = 150, .observers = {&observer}};
      PlanRun run(random, [](const TaskRecipe&, TaskContext& context) {
        context.ReportProgress(0.3);
        context.ReportProgress(0.6);
      });
      ASSERT_EQ(run.Run(*executor, run_options), expected) << "seed " << seed << ", threads " << threads;
      ASSERT_EQ(observer.wrong(), 0) << "seed " << seed << ", threads " << threads;
      ASSERT_EQ(observer.finished(), expected.size());
      ASSERT_EQ(run.report().done + run.report().failed + run.report().skipped, expected.size());
      ASSERT_LE(run.report().peak_live_bytes, 150u);
      failed += run.report().failed;
      skipped += run.report().skipped;
      grown += expected.size() - 80;
    }
  }
  EXPECT_GT(failed, 100u);  // the cases above are not empty
  EXPECT_GT(skipped, 100u);
  EXPECT_GT(grown, 1000u);
}

TEST(ExecutorProperty, LiveBytesNeverExceedTheBudgetByTheTasksOwnCount) {
  bool overlapped = false;
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    const RandomPlan random({.seed = seed, .tasks = 60, .most_bytes = 60, .most_retained_bytes = 20});
    // Results are kept from a task's end to the end of the last one that needs it; here counted by the tasks
    // themselves.
    std::map<std::string, int> consumers_left;
    std::map<std::string, TaskRecipe> recipes;
    for (int i = 0; i < 60; ++i) {
      const auto recipe = random.Initial(i);
      recipes[recipe.name] = recipe;
      for (const auto& need : recipe.needs) ++consumers_left[need];
    }
    std::mutex mutex;
    std::uint64_t live = 0, most = 0;
    int running = 0, most_running = 0;
    const std::map<std::string, int> all_consumers = consumers_left;
    const auto inside = [&](const TaskRecipe& recipe, TaskContext&) {
      {
        const std::lock_guard lock(mutex);
        most = std::max(most, live += recipe.cost.peak_bytes);
        most_running = std::max(most_running, ++running);
      }
      std::this_thread::sleep_for(std::chrono::microseconds(200));
      const std::lock_guard lock(mutex);
      --running;
      live -= recipe.cost.peak_bytes;
      if (consumers_left[recipe.name] > 0) live += recipe.retained_bytes;
      for (const auto& need : recipe.needs)
        if (--consumers_left[need] == 0) live -= recipes[need].retained_bytes;
    };
    // The smallest budget that the serial executor accepts is the hardest for the parallel one.
    std::uint64_t budget = 60;
    while (true) {
      try {
        PlanRun(random).Run(*MakeSerialExecutor(), {.memory_bytes = budget});
        break;
      } catch (const Error&) {
        ++budget;
      }
    }
    for (const std::uint64_t more : {0u, 40u, 400u}) {
      live = most = 0;
      running = most_running = 0;
      consumers_left = all_consumers;
      PlanRun run(random, inside);
      run.Run(*MakeFlowExecutor(), {.threads = 4, .memory_bytes = budget + more});
      ASSERT_EQ(run.report().done, 60u) << "seed " << seed;
      ASSERT_LE(most, budget + more) << "seed " << seed;
      ASSERT_LE(most, run.report().peak_live_bytes);
      ASSERT_EQ(live, 0u);
      overlapped |= most_running > 1;
    }
  }
  // In one plan a busy machine may run short tasks one after the other; in all of them it does not.
  EXPECT_TRUE(overlapped);
}

TEST(ExecutorProperty, WorkOverlaps) {
  // Each waits for the other: only a run that has both under way at once ends them without a timeout.
  std::mutex mutex;
  std::condition_variable arrived;
  int here = 0;
  const auto meet = [&](TaskContext&) {
    std::unique_lock lock(mutex);
    ++here;
    arrived.notify_all();
    if (!arrived.wait_for(lock, std::chrono::seconds(10), [&] { return here == 2; })) throw std::runtime_error("alone");
  };
  Plan plan;
  plan.Add(MakeTask("a", {}, 10, meet));
  plan.Add(MakeTask("b", {}, 10, meet));
  EXPECT_EQ(MakeFlowExecutor()->Run(plan, {.threads = 2, .memory_bytes = 20}).done, 2u);
}

TEST(ExecutorProperty, TasksThatDoNotFitTogetherDoNotOverlap) {
  std::atomic<int> running{0}, overlaps{0};
  Plan plan;
  for (int i = 0; i < 30; ++i) {
    plan.Add(MakeTask(std::to_string(i), {}, 11, [&](TaskContext&) {
      overlaps += running.fetch_add(1) > 0;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      running.fetch_sub(1);
    }));
  }
  const auto report = MakeFlowExecutor()->Run(plan, {.threads = 2, .memory_bytes = 20});
  EXPECT_EQ(report.done, 30u);
  EXPECT_EQ(overlaps, 0);
  EXPECT_EQ(report.peak_live_bytes, 11u);
}

TEST(ExecutorProperty, LowestIdFirst) {
  std::vector<std::string> order;
  Plan plan;
  const auto note = [&](const std::string& name) { return [&order, name](TaskContext&) { order.push_back(name); }; };
  const auto last = plan.Add(MakeTask("0", {}, 1, note("0")));
  for (int i = 1; i < 50; ++i) {
    // Every third one becomes ready late, yet before the higher ones that have been ready all the time.
    std::vector<TaskId> needs;
    if (i % 3 == 0) needs = {TaskId(static_cast<std::uint32_t>(i - 1)), last};
    plan.Add(MakeTask(std::to_string(i), needs, 1, note(std::to_string(i))));
  }
  MakeFlowExecutor()->Run(plan, {.threads = 1, .memory_bytes = 5});
  for (int i = 0; i < 50; ++i) EXPECT_EQ(order[static_cast<std::size_t>(i)], std::to_string(i));
}

TEST(ExecutorProperty, ALargeTaskIsNotStarvedBySmallOnes) {
  std::atomic<int> started{0}, large_started_as{-1};
  Plan plan;
  const auto small = [&](TaskContext&) {
    ++started;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  const auto first = plan.Add(MakeTask("first", {}, 10, small));
  plan.Add(MakeTask("large", {first}, 95, [&](TaskContext&) { large_started_as = started++; }));
  for (int i = 0; i < 200; ++i) plan.Add(MakeTask("small " + std::to_string(i), {}, 10, small));
  EXPECT_EQ(MakeFlowExecutor()->Run(plan, {.threads = 4, .memory_bytes = 100}).done, 202u);
  // While "first" runs the other three threads take small ones; nothing is admitted past the large one after that,
  // however long the small ones that had begun take.
  EXPECT_LT(large_started_as, 60);
}

TEST(ExecutorProperty, SmallTasksThatDelayNobodyPassALargeOne) {
  // "long" keeps 50; "large" needs 80 and waits; tasks of 20 fit beside both of them and use the time.
  std::atomic<bool> large_started{false};
  std::atomic<int> passed{0};
  Plan plan;
  plan.Add(MakeTask("long", {}, 50, [&](TaskContext&) {
    for (int i = 0; i < 10000 && passed < 20; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }));
  plan.Add(MakeTask("large", {}, 80, [&](TaskContext&) { large_started = true; }));
  for (int i = 0; i < 20; ++i)
    plan.Add(MakeTask(std::to_string(i), {}, 20, [&](TaskContext&) { passed += !large_started; }));
  EXPECT_EQ(MakeFlowExecutor()->Run(plan, {.threads = 2, .memory_bytes = 100}).done, 22u);
  EXPECT_EQ(passed, 20);
}

thread_local int bodies_on_this_thread = 0;

TEST(ExecutorProperty, AWaitingThreadNeverStartsAnotherTask) {
  std::atomic<int> nested{0};
  const auto body = [&](auto&& work) {
    return [&, work](TaskContext& context) {
      nested += bodies_on_this_thread++ > 0;
      work(context);
      --bodies_on_this_thread;
    };
  };
  Plan plan;
  for (int i = 0; i < 60; ++i) {
    plan.Add(MakeTask("loop " + std::to_string(i), {}, 0, body([&](TaskContext& context) {
                        context.ParallelFor(64, 2, [&](std::size_t begin, std::size_t) {
                          context.ReportProgress(static_cast<double>(begin) / 64);
                          const auto until =
                              std::chrono::steady_clock::now() + std::chrono::microseconds(begin % 8 == 0 ? 100 : 5);
                          while (std::chrono::steady_clock::now() < until) {
                          }
                        });
                      })));
    for (int k = 0; k < 5; ++k)
      plan.Add(MakeTask("short " + std::to_string(5 * i + k), {}, 0, body([](TaskContext&) {})));
  }
  StrictObserver observer;
  EXPECT_EQ(MakeFlowExecutor()->Run(plan, {.threads = 4, .observers = {&observer}}).done, 360u);
  EXPECT_EQ(nested, 0);
  EXPECT_EQ(observer.wrong(), 0);
}

TEST(ExecutorProperty, LoopsAreSharedBetweenThreads) {
  std::atomic<bool> shared{false};
  Plan plan;
  plan.Add(MakeTask("loop", {}, 0, [&](TaskContext& context) {
    const auto owner = std::this_thread::get_id();
    const auto give_up = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    context.ParallelFor(64, 1, [&](std::size_t, std::size_t) {
      if (std::this_thread::get_id() != owner) shared = true;
      while (!shared && std::chrono::steady_clock::now() < give_up) std::this_thread::yield();
    });
  }));
  EXPECT_EQ(MakeFlowExecutor()->Run(plan, {.threads = 4}).done, 1u);
  EXPECT_TRUE(shared);
}

TEST(ExecutorProperty, StoppedAnywhereWhatIsDoneIsRight) {
  for (std::uint64_t seed = 0; seed < 30; ++seed) {
    const RandomPlan random({.seed = seed, .tasks = 80, .failing = 0.03, .growing = 0.2});
    const auto expected = Expected(random);
    StopSource stop;
    std::atomic<int> count{0};
    const int stop_at = static_cast<int>(seed * 3);
    PlanRun run(random, [&](const TaskRecipe&, TaskContext&) {
      if (count++ == stop_at) stop.RequestStop();
    });
    const auto results = run.Run(*MakeFlowExecutor(), {.threads = 2, .stop = &stop});
    std::size_t cancelled = 0;
    for (const auto& [name, result] : results) {
      cancelled += result.state == TaskState::kCancelled;
      const bool ran = result.state == TaskState::kDone || result.state == TaskState::kFailed;
      ASSERT_TRUE(!ran || result == expected.at(name)) << name;
      ASSERT_NE(result.state, TaskState::kPending);
    }
    ASSERT_EQ(run.report().cancelled, cancelled > 0);
    ASSERT_LE(count, stop_at + 3);
  }
}

}  // namespace
}  // namespace rilievo::engine
