// What an executor promises, on small plans, for both of them.
#include "engine/executor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <mutex>
#include <new>
#include <stdexcept>
#include <thread>

#include "base/error.h"

namespace rilievo::engine {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Body = std::function<void(TaskContext&)>;

Task MakeTask(
    std::string name, std::vector<TaskId> needs, Body run = [](TaskContext&) {}) {
  Task task;
  task.name = std::move(name);
  task.stage = "test";
  task.needs = std::move(needs);
  task.run = std::move(run);
  return task;
}

std::vector<TaskState> States(const ExecutionReport& report) {
  std::vector<TaskState> states;
  for (const auto& outcome : report.outcomes) states.push_back(outcome.state);
  return states;
}

struct Executors {
  const char* name;
  std::unique_ptr<Executor> (*make)();
  int threads;
};

class ExecutorTest : public ::testing::TestWithParam<Executors> {
 protected:
  ExecutionReport Run(Plan& plan) {
    options_.threads = GetParam().threads;
    return GetParam().make()->Run(plan, options_);
  }
  ExecutionOptions options_;
};

TEST_P(ExecutorTest, AnEmptyPlanIsDone) {
  Plan plan;
  const auto report = Run(plan);
  EXPECT_TRUE(report.outcomes.empty());
  EXPECT_FALSE(report.cancelled);
}

TEST_P(ExecutorTest, FailureSkipsDescendantsOnly) {
  Plan plan;
  const auto a = plan.Add(MakeTask("a", {}));
  const auto b = plan.Add(MakeTask(
      "b", {}, [](TaskContext&) { throw Error(ErrorCode::kUnreadable, "x.jpg", "is not an image", "remove it"); }));
  const auto c = plan.Add(MakeTask("c", {a, b}));
  plan.Add(MakeTask("d", {c}));
  plan.Add(MakeTask("e", {a}));
  const auto report = Run(plan);
  using enum TaskState;
  EXPECT_THAT(States(report), ElementsAre(kDone, kFailed, kSkipped, kSkipped, kDone));
  EXPECT_EQ(report.outcomes[b.value].error, "x.jpg: is not an image (remove it)");
  EXPECT_EQ(report.done, 2u);
  EXPECT_EQ(report.failed, 1u);
  EXPECT_EQ(report.skipped, 2u);
  EXPECT_FALSE(report.cancelled);
}

TEST_P(ExecutorTest, WhateverIsThrownIsOneLine) {
  Plan plan;
  plan.Add(MakeTask("no memory", {}, [](TaskContext&) { throw std::bad_alloc(); }));
  plan.Add(MakeTask("two lines", {}, [](TaskContext&) { throw std::runtime_error("one\ntwo"); }));
  plan.Add(MakeTask("a number", {}, [](TaskContext&) { throw 1; }));
  const auto report = Run(plan);
  EXPECT_EQ(report.failed, 3u);
  EXPECT_THAT(report.outcomes[0].error, HasSubstr("no memory left"));
  EXPECT_EQ(report.outcomes[1].error, "two lines: one two");
  EXPECT_THAT(report.outcomes[2].error, HasSubstr("a number"));
}

TEST_P(ExecutorTest, GrownTasksRunAfterTheirGrowerAndMayNeedOldOnes) {
  Plan plan;
  std::mutex mutex;
  std::vector<std::string> order;
  const auto note = [&](std::string name) {
    return [&, name](TaskContext&) {
      const std::lock_guard lock(mutex);
      order.push_back(name);
    };
  };
  const auto a = plan.Add(MakeTask("a", {}, note("a")));
  const auto b = plan.Add(MakeTask("b", {a}, [&](TaskContext& context) {
    note("b")(context);
    context.Grow([&, a](Plan& grown) {
      const auto c = grown.Add(MakeTask("c", {a, TaskId(1)}, note("c")));
      grown.Add(MakeTask("d", {c}, [&](TaskContext& inner) {
        note("d")(inner);
        inner.Grow([&](Plan& again) { again.Add(MakeTask("e", {TaskId(3)}, note("e"))); });
      }));
    });
  }));
  EXPECT_EQ(b, TaskId(1));
  const auto report = Run(plan);
  EXPECT_EQ(report.done, 5u);
  EXPECT_EQ(plan.size(), 5u);
  EXPECT_THAT(order, ElementsAre("a", "b", "c", "d", "e"));
}

TEST_P(ExecutorTest, GrowthThatThrowsFailsItsTaskAndSkipsWhatItAdded) {
  Plan plan;
  const auto a = plan.Add(MakeTask("a", {}, [](TaskContext& context) {
    context.Grow([](Plan& grown) {
      grown.Add(MakeTask("b", {}));
      throw std::runtime_error("no");
    });
  }));
  plan.Add(MakeTask("c", {a}));
  plan.Add(MakeTask("d", {}));
  const auto report = Run(plan);
  using enum TaskState;
  EXPECT_THAT(States(report), ElementsAre(kFailed, kSkipped, kDone, kSkipped));
  EXPECT_EQ(report.outcomes[0].error, "a: no");
}

TEST_P(ExecutorTest, AFailedTaskGrowsNothing) {
  Plan plan;
  plan.Add(MakeTask("a", {}, [](TaskContext& context) {
    context.Grow([](Plan& grown) { grown.Add(MakeTask("b", {})); });
    throw std::runtime_error("after all not");
  }));
  EXPECT_EQ(Run(plan).outcomes.size(), 1u);
}

TEST_P(ExecutorTest, ATaskLargerThanTheBudgetIsRefusedBeforeAnythingStarts) {
  Plan plan;
  bool started = false;
  plan.Add(MakeTask("small", {}, [&](TaskContext&) { started = true; }));
  Task large = MakeTask("large one", {});
  large.cost.peak_bytes = std::uint64_t{3} << 30;
  large.memory_hint = "raise --memory to 3 GiB";
  plan.Add(std::move(large));
  options_.memory_bytes = std::uint64_t{1} << 30;
  try {
    Run(plan);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kOutOfMemoryBudget);
    for (const char* part : {"large one", "3.0 GiB", "1.0 GiB", "raise --memory to 3 GiB"})
      EXPECT_THAT(error.what(), HasSubstr(part));
  }
  EXPECT_FALSE(started);
}

TEST_P(ExecutorTest, ResultsKeptInMemoryCountTowardsTheRefusal) {
  Plan plan;
  std::vector<TaskId> parts;
  for (int i = 0; i < 3; ++i) {
    Task part = MakeTask("part " + std::to_string(i), {});
    part.cost.peak_bytes = 10;
    part.retained_bytes = 10;
    parts.push_back(plan.Add(std::move(part)));
  }
  Task whole = MakeTask("whole", parts);
  whole.cost.peak_bytes = 15;
  plan.Add(std::move(whole));
  options_.memory_bytes = 45;
  EXPECT_EQ(Run(plan).done, 4u);
  options_.memory_bytes = 44;
  EXPECT_THROW(Run(plan), Error);
}

TEST_P(ExecutorTest, AGrownTaskThatNeverFitsFailsAlone) {
  Plan plan;
  plan.Add(MakeTask("a", {}, [](TaskContext& context) {
    context.Grow([](Plan& grown) {
      Task large = MakeTask("large", {});
      large.cost.peak_bytes = 1000;
      large.memory_hint = "use fewer images";
      const auto id = grown.Add(std::move(large));
      grown.Add(MakeTask("after large", {id}));
      grown.Add(MakeTask("other", {}));
    });
  }));
  options_.memory_bytes = 100;
  const auto report = Run(plan);
  using enum TaskState;
  EXPECT_THAT(States(report), ElementsAre(kDone, kFailed, kSkipped, kDone));
  EXPECT_THAT(report.outcomes[1].error, HasSubstr("use fewer images"));
}

TEST_P(ExecutorTest, GrowthThatKeepsTooManyResultsFailsInsteadOfHanging) {
  Plan plan;
  std::vector<TaskId> parts;
  for (int i = 0; i < 3; ++i) {
    Task part = MakeTask("part " + std::to_string(i), {});
    part.cost.peak_bytes = part.retained_bytes = 30;
    parts.push_back(plan.Add(std::move(part)));
  }
  plan.Add(MakeTask("grower", parts, [parts](TaskContext& context) {
    context.Grow([parts](Plan& grown) {
      Task whole = MakeTask("whole", parts);
      whole.cost.peak_bytes = 20;
      grown.Add(std::move(whole));
      grown.Add(MakeTask("light", {}));
    });
  }));
  options_.memory_bytes = 100;
  const auto report = Run(plan);
  EXPECT_EQ(report.done, 5u);
  EXPECT_EQ(report.outcomes[4].state, TaskState::kFailed);
  EXPECT_THAT(report.outcomes[4].error, HasSubstr("90 B of results kept"));
}

TEST_P(ExecutorTest, StopBeforeTheStartCancelsEverything) {
  StopSource stop;
  stop.RequestStop();
  options_.stop = &stop;
  Plan plan;
  const auto a = plan.Add(MakeTask("a", {}));
  plan.Add(MakeTask("b", {a}));
  const auto report = Run(plan);
  EXPECT_TRUE(report.cancelled);
  EXPECT_THAT(States(report), ElementsAre(TaskState::kCancelled, TaskState::kCancelled));
}

TEST_P(ExecutorTest, CooperativeTasksStopWithin100Milliseconds) {
  StopSource stop;
  options_.stop = &stop;
  Plan plan;
  for (int i = 0; i < 20; ++i) {
    plan.Add(MakeTask("t" + std::to_string(i), {}, [](TaskContext& context) {
      for (int step = 0; step < 3000; ++step) {
        context.ThrowIfStopped();
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    }));
  }
  std::chrono::steady_clock::time_point requested;
  std::thread user([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    requested = std::chrono::steady_clock::now();
    stop.RequestStop();
  });
  const auto report = Run(plan);
  const auto ended = std::chrono::steady_clock::now();
  user.join();
  EXPECT_LT(std::chrono::duration<double>(ended - requested).count(), 0.1);
  EXPECT_TRUE(report.cancelled);
  EXPECT_EQ(report.done, 0u);
  for (const auto state : States(report)) EXPECT_EQ(state, TaskState::kCancelled);
}

TEST_P(ExecutorTest, ATaskThatGivesUpCancelsItsDescendants) {
  Plan plan;
  const auto a = plan.Add(MakeTask("a", {}, [](TaskContext&) { throw Cancelled(); }));
  plan.Add(MakeTask("b", {a}));
  plan.Add(MakeTask("c", {}));
  const auto report = Run(plan);
  using enum TaskState;
  EXPECT_THAT(States(report), ElementsAre(kCancelled, kCancelled, kDone));
  EXPECT_TRUE(report.cancelled);
}

TEST_P(ExecutorTest, ParallelForCoversTheRangeOnceWithBordersAtMultiplesOfTheGrain) {
  Plan plan;
  for (const std::size_t n : {0, 1, 7, 8, 9, 1000}) {
    plan.Add(MakeTask("n=" + std::to_string(n), {}, [n](TaskContext& context) {
      std::vector<std::atomic<int>> seen(n);
      std::atomic<int> bad{0};
      context.ParallelFor(n, 8, [&](std::size_t begin, std::size_t end) {
        bad += begin % 8 != 0 || end <= begin || end - begin > 8 || (end % 8 != 0 && end != n);
        for (std::size_t i = begin; i < end; ++i) ++seen[i];
      });
      for (const auto& count : seen) bad += count != 1;
      if (bad != 0) throw std::runtime_error("range not covered once");
    }));
  }
  plan.Add(MakeTask("throws inside", {}, [](TaskContext& context) {
    context.ParallelFor(100, 1, [](std::size_t begin, std::size_t) {
      if (begin == 50) throw Error(ErrorCode::kInvalidInput, "p", "m", "h");
    });
  }));
  const auto report = Run(plan);
  EXPECT_EQ(report.done, 6u);
  EXPECT_EQ(report.outcomes[6].error, "p: m (h)");
}

TEST_P(ExecutorTest, SeedBytesAndReuseArrive) {
  struct Keep : Observer {
    TaskSpan span;
    void OnTaskFinished(TaskId, const Task&, const TaskOutcome&, const TaskSpan& s) override { span = s; }
  } keep;
  options_.observers = {&keep};
  options_.seed = 77;
  Plan plan;
  std::uint64_t seed = 0;
  plan.Add(MakeTask("a", {}, [&](TaskContext& context) {
    seed = context.Seed();
    context.CountBytes(1, 2);
    context.CountBytes(10, 20);
    context.MarkReused();
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }));
  const auto report = Run(plan);
  EXPECT_EQ(seed, 77u);
  EXPECT_EQ(report.reused, 1u);
  EXPECT_TRUE(report.outcomes[0].reused);
  EXPECT_TRUE(keep.span.reused);
  EXPECT_EQ(keep.span.read_bytes, 11u);
  EXPECT_EQ(keep.span.written_bytes, 22u);
  EXPECT_GE(keep.span.end_s - keep.span.start_s, 0.002);
}

TEST_P(ExecutorTest, AnObserverThatThrowsEndsTheRunAndIsHeard) {
  struct Bad : Observer {
    void OnTaskFinished(TaskId, const Task&, const TaskOutcome&, const TaskSpan&) override {
      throw std::runtime_error("observer");
    }
  } bad;
  options_.observers = {&bad};
  Plan plan;
  for (int i = 0; i < 10; ++i) plan.Add(MakeTask("t" + std::to_string(i), {}));
  EXPECT_THROW(Run(plan), std::runtime_error);
}

INSTANTIATE_TEST_SUITE_P(Both, ExecutorTest,
                         ::testing::Values(Executors{"Serial", &MakeSerialExecutor, 1},
                                           Executors{"FlowOne", &MakeFlowExecutor, 1},
                                           Executors{"FlowTwo", &MakeFlowExecutor, 2},
                                           Executors{"FlowFour", &MakeFlowExecutor, 4}),
                         [](const auto& each) { return each.param.name; });

TEST(PlanTest, FindsByStageInOrder) {
  Plan plan;
  for (int i = 0; i < 6; ++i) {
    Task task = MakeTask(std::to_string(i), {});
    task.stage = i % 2 == 0 ? "even" : "odd";
    plan.Add(std::move(task));
  }
  EXPECT_THAT(plan.FindByStage("odd"), ElementsAre(TaskId(1), TaskId(3), TaskId(5)));
  EXPECT_TRUE(plan.FindByStage("none").empty());
}

TEST(PlanDeathTest, CallersBugsAreChecked) {
  Plan plan;
  plan.Add(MakeTask("a", {}));
  EXPECT_DEATH(plan.Add(MakeTask("a", {})), "names_");
  EXPECT_DEATH(plan.Add(MakeTask("b", {TaskId(1)})), "need");
  EXPECT_DEATH(plan.Add(MakeTask("c", {}, nullptr)), "run");
}

}  // namespace
}  // namespace rilievo::engine
