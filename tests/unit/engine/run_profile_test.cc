// What a profile says of a run: against runs whose times are known, and against counting in small steps.
#include "engine/run_profile.h"

#include <gtest/gtest.h>
#include <time.h>
#include <unistd.h>

#include <cmath>
#include <fstream>
#include <random>
#include <thread>

#include "base/error.h"
#include "engine/machine_peak.h"

namespace rilievo::engine {
namespace {

RecordedTask MakeTask(std::uint32_t id, const std::string& stage, int worker, double start_s, double end_s,
                      std::vector<std::uint32_t> needs = {}) {
  RecordedTask task;
  task.id = id;
  task.name = stage + " " + std::to_string(id);
  task.stage = stage;
  task.state = "done";
  task.needs = std::move(needs);
  task.span.task = TaskId(id);
  task.span.worker = worker;
  task.span.start_s = start_s;
  task.span.end_s = end_s;
  task.span.cpu_s = 0.5 * (end_s - start_s);
  return task;
}

const StageProfile& StageOf(const RunProfile& profile, const std::string& name) {
  for (const auto& stage : profile.stages)
    if (stage.name == name) return stage;
  throw std::out_of_range(name);
}

TEST(RunProfile, OfARunOnPaper) {
  // worker 0: a 0-4, c 4-6          worker 1: b 0-1, (idle 1-3), d 3-5, (idle 5-6); e helps nobody
  RecordedRun run;
  run.facts.threads = 2;
  run.tasks = {MakeTask(0, "features", 0, 0, 4), MakeTask(1, "features", 1, 0, 1),
               MakeTask(2, "pairs", 0, 4, 6, {0, 1}), MakeTask(3, "pairs", 1, 3, 5, {1})};
  for (RecordedTask& task : run.tasks) task.unit = task.stage == "pairs" ? "pairs" : "Mpx";
  run.tasks[0].units = 12;
  run.tasks[1].units = 6;
  run.tasks[2].units = 3;
  run.tasks[3].units = 5;
  run.tasks[3].span.reused = true;
  run.tasks[0].peak_bytes = 500;
  run.tasks[0].span.read_bytes = 7;
  run.tasks[1].span.read_bytes = 8;
  run.resident = {{0.5, 100}, {2, 900}, {4.5, 300}, {6, 400}};
  run.tasks[0].kernels = {{"scale space", KernelName::Arithmetic::kFloats, 6e9, 1.5}};
  run.tasks[1].kernels = {{"scale space", KernelName::Arithmetic::kFloats, 2e9, 0.5}};

  const RunProfile profile = ProfileOf(run, {.bytes_per_s = 0, .floats_per_s = 16e9});
  EXPECT_DOUBLE_EQ(profile.wall_s, 6);
  EXPECT_DOUBLE_EQ(profile.cpu_s, 4.5);
  EXPECT_DOUBLE_EQ(profile.idle_s, 3);
  EXPECT_DOUBLE_EQ(profile.busy_share, 0.75);
  EXPECT_DOUBLE_EQ(profile.critical_s, 6);
  EXPECT_EQ(profile.critical_path, (std::vector<std::uint32_t>{0, 2}));
  const StageProfile &features = StageOf(profile, "features"), &pairs = StageOf(profile, "pairs");
  EXPECT_DOUBLE_EQ(features.wall_s, 4);
  EXPECT_DOUBLE_EQ(features.units_per_s, 18 / 4.0);
  EXPECT_EQ(features.unit, "Mpx");
  EXPECT_EQ(features.read_bytes, 15u);
  EXPECT_EQ(features.planned_peak_bytes, 500u);
  EXPECT_EQ(features.resident_peak_bytes, 900u);
  EXPECT_DOUBLE_EQ(features.critical_s, 4);
  EXPECT_DOUBLE_EQ(features.share_of_machine, 2.5 / 12);
  EXPECT_DOUBLE_EQ(pairs.wall_s, 3);
  EXPECT_EQ(pairs.reused, 1u);
  EXPECT_DOUBLE_EQ(pairs.units, 3);  // what was there already was not computed
  EXPECT_EQ(pairs.resident_peak_bytes, 400u);
  ASSERT_EQ(profile.kernels.size(), 1u);
  EXPECT_DOUBLE_EQ(profile.kernels[0].rate_per_s, 4e9);
  EXPECT_DOUBLE_EQ(profile.kernels[0].share_of_peak, 0.25);
  ASSERT_EQ(profile.gaps.size(), 2u);
  EXPECT_EQ(profile.gaps[0].worker, 1);
  EXPECT_DOUBLE_EQ(profile.gaps[0].start_s, 1);
  EXPECT_DOUBLE_EQ(profile.gaps[0].end_s, 3);
  EXPECT_EQ(profile.gaps[0].beside, "features 0");
  EXPECT_EQ(profile.gaps[1].beside, "pairs 2");
}

/// Random tasks on a grid of whole seconds: counted second by second, and chains by trying all.
TEST(RunProfile, AgreesWithCountingInSteps) {
  std::mt19937 random(4);
  for (int round = 0; round < 200; ++round) {
    RecordedRun run;
    run.facts.threads = 1 + static_cast<int>(random() % 4);
    const int end = 30;
    std::vector<std::vector<int>> busy(static_cast<std::size_t>(run.facts.threads), std::vector<int>(end));
    std::vector<int> by_stage[3] = {std::vector<int>(end), std::vector<int>(end), std::vector<int>(end)};
    int last = 0;
    for (int worker = 0; worker < run.facts.threads; ++worker) {
      for (int t = static_cast<int>(random() % 5); t < end - 6;) {
        const int length = 1 + static_cast<int>(random() % 5), stage = static_cast<int>(random() % 3);
        const auto id = static_cast<std::uint32_t>(run.tasks.size());
        run.tasks.push_back(MakeTask(id, std::string(1, static_cast<char>('a' + stage)), worker, t, t + length));
        for (int i = t; i < t + length; ++i) {
          busy[static_cast<std::size_t>(worker)][static_cast<std::size_t>(i)] = 1;
          by_stage[stage][static_cast<std::size_t>(i)] = 1;
        }
        last = std::max(last, t + length);
        t += length + static_cast<int>(random() % 3);
      }
    }
    if (run.tasks.empty()) continue;
    for (RecordedTask& task : run.tasks)
      for (std::uint32_t k = 0; k < task.id; ++k)
        if (random() % 6 == 0 && run.tasks[k].span.end_s <= task.span.start_s) task.needs.push_back(k);
    std::vector<double> longest(run.tasks.size());
    for (int pass = 0; pass < 40; ++pass)
      for (const RecordedTask& task : run.tasks) {
        double before = 0;
        for (const auto need : task.needs) before = std::max(before, longest[need]);
        longest[task.id] = before + task.span.end_s - task.span.start_s;
      }

    const RunProfile profile = ProfileOf(run, {});
    double busy_s = 0;
    for (const auto& worker : busy)
      for (const int second : worker) busy_s += second;
    EXPECT_DOUBLE_EQ(profile.wall_s, last);
    EXPECT_NEAR(profile.worker_s, busy_s, 1e-9);
    EXPECT_NEAR(profile.idle_s, run.facts.threads * last - busy_s, 1e-9);
    EXPECT_DOUBLE_EQ(profile.critical_s, *std::max_element(longest.begin(), longest.end()));
    for (const StageProfile& stage : profile.stages) {
      double wall_s = 0;
      for (const int second : by_stage[stage.name[0] - 'a']) wall_s += second;
      EXPECT_DOUBLE_EQ(stage.wall_s, wall_s);
    }
    for (std::size_t i = 1; i < profile.critical_path.size(); ++i) {
      const auto& needs = run.tasks[profile.critical_path[i]].needs;
      EXPECT_NE(std::find(needs.begin(), needs.end(), profile.critical_path[i - 1]), needs.end());
    }
  }
}

void Burn(double seconds_s) {
  timespec start{}, now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &start);
  do ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  while (static_cast<double>(now.tv_sec - start.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec - start.tv_nsec) <
         seconds_s);
}

constexpr KernelName kBurn{"burn", KernelName::Arithmetic::kBytes};

/// From the executor through the file: what the tasks did is what the profile says.
TEST(RunProfile, OfARealRunThroughItsTraceFile) {
  Plan plan;
  const auto work = [](TaskContext& context) {
    Burn(0.02);
    context.RunKernel(kBurn, 1000, [&] {
      context.ParallelFor(8, 1,
                          [](std::size_t begin, std::size_t end) { Burn(0.01 * static_cast<double>(end - begin)); });
    });
    context.CountBytes(5, 6);
  };
  const auto first = plan.Add({.name = "first",
                               .stage = "one",
                               .needs = {},
                               .cost = {1000, 1},
                               .units = {2, "Mpx"},
                               .memory_hint = "",
                               .run = work});
  plan.Add({.name = "second",
            .stage = "two",
            .needs = {first},
            .cost = {},
            .units = {3, "pairs"},
            .memory_hint = "",
            .run = [](TaskContext&) { std::this_thread::sleep_for(std::chrono::milliseconds(30)); }});
  for (const bool serial : {false, true}) {
    const MemoryCurve memory;
    Trace trace({.threads = 2, .memory_bytes = 1 << 20, .before_s = 1.5, .processor = ProcessorName()}, &memory);
    (serial ? MakeSerialExecutor() : MakeFlowExecutor())->Run(plan, {.threads = 2, .observers = {&trace}});
    const auto path = std::filesystem::temp_directory_path() / ("rilievo-p-" + std::to_string(::getpid()) + ".json");
    trace.Write(path);
    const RecordedRun run = ReadTrace(path);
    std::filesystem::remove(path);
    ASSERT_EQ(run.tasks.size(), 2u);
    EXPECT_EQ(run.facts.threads, 2);
    EXPECT_EQ(run.facts.before_s, 1.5);
    EXPECT_GT(run.process_peak_bytes, std::uint64_t{1} << 20);
    EXPECT_FALSE(run.resident.empty());
    const RunProfile profile = ProfileOf(run, {.bytes_per_s = 1e6, .floats_per_s = 1});
    const StageProfile &one = StageOf(profile, "one"), &two = StageOf(profile, "two");
    EXPECT_NEAR(one.cpu_s, 0.1, 0.03);  // of helpers, too, whoever they were
    EXPECT_LT(two.cpu_s, 0.02);
    EXPECT_GE(two.wall_s, 0.03);
    EXPECT_NEAR(two.units_per_s * two.wall_s, 3, 1e-6);
    EXPECT_EQ(one.read_bytes, 5u);
    EXPECT_EQ(one.written_bytes, 6u);
    EXPECT_NEAR(profile.critical_s, one.wall_s + two.wall_s, 1e-6);
    ASSERT_EQ(profile.kernels.size(), 1u);
    EXPECT_EQ(profile.kernels[0].name, "burn");
    EXPECT_EQ(profile.kernels[0].multiply_adds, 1000);
    EXPECT_NEAR(profile.kernels[0].cpu_s, 0.08, 0.02);
    EXPECT_NEAR(profile.kernels[0].share_of_peak, 1000 / profile.kernels[0].cpu_s / 1e6, 1e-9);
    // A helper's time is busy time of its worker.
    if (!serial && !run.tasks[0].span.helpers.empty()) {
      EXPECT_GT(one.worker_s, one.wall_s + 0.005);
      EXPECT_NE(run.tasks[0].span.helpers[0].worker, run.tasks[0].span.worker);
    }
  }
}

TEST(RunProfile, RefusesWhatIsNoTrace) {
  const auto path = std::filesystem::temp_directory_path() / ("rilievo-q-" + std::to_string(::getpid()) + ".json");
  EXPECT_THROW(ReadTrace(path), Error);
  for (const char* text : {"", "{}", "[1]", "{\"traceEvents\":[{\"ph\":\"X\",\"cat\":\"a\"}]}",
                           "{\"otherData\":{\"version\":9},\"traceEvents\":[]}"}) {
    std::ofstream(path) << text;
    EXPECT_THROW(ReadTrace(path), Error) << text;
  }
  std::filesystem::remove(path);
}

TEST(MemoryCurve, HalvingKeepsTheLargestAndTheEnd) {
  EXPECT_TRUE(Halved({}).empty());
  const auto half = Halved({{1, 5}, {2, 3}, {3, 1}, {4, 9}, {5, 2}});
  ASSERT_EQ(half.size(), 3u);
  EXPECT_EQ(half[0].bytes, 5u);
  EXPECT_EQ(half[0].time_s, 2);
  EXPECT_EQ(half[1].bytes, 9u);
  EXPECT_EQ(half[2].bytes, 2u);
}

TEST(MachinePeak, IsAboveWhatPlainCodeDoes) {
  for (const auto arithmetic : {KernelName::Arithmetic::kBytes, KernelName::Arithmetic::kFloats}) {
    const double peak_per_s = MeasurePeak_per_s(arithmetic);
    if (peak_per_s == 0) GTEST_SKIP() << "no loop for this processor";
    EXPECT_GT(peak_per_s, 1e9);
    EXPECT_LT(peak_per_s, 1e13);
    EXPECT_NEAR(MeasurePeak_per_s(arithmetic) / peak_per_s, 1, 0.5);
  }
}

}  // namespace
}  // namespace rilievo::engine
