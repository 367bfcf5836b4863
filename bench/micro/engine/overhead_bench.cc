// What the engine costs a task: 100,000 empty tasks, two threads, beside a bare tbb::task_group in the same run.
#include <benchmark/benchmark.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/task_arena.h>
#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <string>

#include "base/rng.h"
#include "engine/executor.h"

namespace rilievo::engine {
namespace {

constexpr int kTasks = 100000;
constexpr int kThreads = 2;

/// needs_each = 0: independent tasks; otherwise up to so many needs among the 64 tasks before.
Plan EmptyTasks(int needs_each) {
  Plan plan;
  Rng rng(1);
  for (int i = 0; i < kTasks; ++i) {
    Task task;
    task.name = std::to_string(i);
    task.stage = "empty";
    for (int k = 0; k < needs_each && i > 0; ++k) {
      const auto back = 1 + static_cast<int>(rng.Below(static_cast<std::uint32_t>(std::min(i, 64))));
      task.needs.emplace_back(static_cast<std::uint32_t>(i - back));
    }
    task.run = [](TaskContext&) {};
    plan.Add(std::move(task));
  }
  return plan;
}

void PerTask(benchmark::State& state) {
  using benchmark::Counter;
  state.counters["per_task"] = Counter(kTasks, Counter::kIsIterationInvariantRate | Counter::kInvert);
}

void BM_TaskGroup100k(benchmark::State& state) {
  oneapi::tbb::task_arena arena(kThreads);
  for (auto _ : state) {
    arena.execute([] {
      oneapi::tbb::task_group group;
      for (int i = 0; i < kTasks; ++i) group.run([] {});
      group.wait();
    });
  }
  PerTask(state);
}
BENCHMARK(BM_TaskGroup100k)->UseRealTime()->Unit(benchmark::kMillisecond);

void RunPlan(benchmark::State& state, std::unique_ptr<Executor> executor, std::uint64_t memory_bytes) {
  Plan plan = EmptyTasks(static_cast<int>(state.range(0)));
  ExecutionOptions options;
  options.threads = kThreads;
  options.memory_bytes = memory_bytes;
  for (auto _ : state) {
    const auto report = executor->Run(plan, options);
    if (report.done != kTasks) state.SkipWithError("not every task was done");
  }
  PerTask(state);
}

void BM_FlowExecutor100k(benchmark::State& state) { RunPlan(state, MakeFlowExecutor(), 0); }
BENCHMARK(BM_FlowExecutor100k)->ArgName("needs")->Arg(0)->Arg(3)->UseRealTime()->Unit(benchmark::kMillisecond);

void BM_SerialExecutor100k(benchmark::State& state) { RunPlan(state, MakeSerialExecutor(), 0); }
BENCHMARK(BM_SerialExecutor100k)->ArgName("needs")->Arg(0)->Arg(3)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace rilievo::engine
