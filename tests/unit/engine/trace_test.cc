// The trace is whole JSON whatever happened, and its spans and live bytes are those of the run.
#include "engine/trace.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <thread>

namespace rilievo::engine {
namespace {

TaskId Add(Plan& plan, const std::string& name, std::vector<TaskId> needs, std::function<void(TaskContext&)> run,
           std::uint64_t peak_bytes = 0, std::uint64_t retained_bytes = 0) {
  Task task;
  task.name = name;
  task.stage = "stage \"one\"";
  task.needs = std::move(needs);
  task.cost.peak_bytes = peak_bytes;
  task.retained_bytes = retained_bytes;
  task.run = std::move(run);
  return plan.Add(std::move(task));
}

std::map<std::string, nlohmann::json> SpansByName(const nlohmann::json& trace) {
  std::map<std::string, nlohmann::json> spans;
  for (const auto& event : trace["traceEvents"])
    if (event["ph"] == "X") spans[event["name"]] = event;
  return spans;
}

TEST(Trace, SpansCarryTimeWorkerStageAndBytes) {
  Plan plan;
  const auto sleep = [](TaskContext& context) {
    std::this_thread::sleep_for(std::chrono::milliseconds(3));
    context.CountBytes(100, 7);
  };
  const auto a = Add(plan, "a\n\\\xff", {}, sleep, 50, 20);
  const auto b = Add(plan, "b", {a}, sleep, 10);
  Add(plan, "broken", {b}, [](TaskContext&) { throw std::runtime_error("has \"quotes\""); });
  const auto reused = Add(plan, "reused", {}, [](TaskContext& context) { context.MarkReused(); });
  Add(plan, "never", {TaskId(2), reused}, [](TaskContext&) {});
  Trace trace;
  MakeFlowExecutor()->Run(plan, {.threads = 2, .observers = {&trace}});
  const auto json = nlohmann::json::parse(trace.Json());
  const auto spans = SpansByName(json);
  ASSERT_EQ(spans.size(), 4u);
  const auto& span = spans.at("b");
  EXPECT_EQ(span["cat"], "stage \"one\"");
  EXPECT_EQ(span["args"]["read_bytes"], 100);
  EXPECT_EQ(span["args"]["written_bytes"], 7);
  EXPECT_EQ(span["args"]["peak_bytes"], 10);
  EXPECT_EQ(span["args"]["state"], "done");
  EXPECT_GE(span["dur"].get<double>(), 3000);
  EXPECT_GE(span["ts"].get<double>(), 3000);
  EXPECT_EQ(spans.at("broken")["args"]["state"], "failed");
  EXPECT_EQ(spans.at("broken")["args"]["error"], "broken: has \"quotes\"");
  EXPECT_EQ(spans.at("reused")["args"]["reused"], true);
  EXPECT_FALSE(spans.contains("never"));

  std::map<int, std::string> threads;
  std::vector<std::uint64_t> live_bytes;
  for (const auto& event : json["traceEvents"]) {
    if (event["ph"] == "M" && event["name"] == "thread_name") threads[event["tid"]] = event["args"]["name"];
    if (event["ph"] == "C") live_bytes.push_back(event["args"]["bytes"]);
  }
  for (const auto& [name, each] : spans) EXPECT_TRUE(threads.contains(each["tid"].get<int>())) << name;
  EXPECT_EQ(live_bytes, (std::vector<std::uint64_t>{50, 20, 30, 0}));
}

TEST(Trace, OfACancelledRunIsWhole) {
  Plan plan;
  StopSource stop;
  for (int i = 0; i < 10; ++i) {
    Add(plan, std::to_string(i), {}, [&, i](TaskContext& context) {
      if (i == 3) stop.RequestStop();
      context.ThrowIfStopped();
    });
  }
  Trace trace;
  const auto report = MakeSerialExecutor()->Run(plan, {.stop = &stop, .observers = {&trace}});
  EXPECT_TRUE(report.cancelled);
  const auto spans = SpansByName(nlohmann::json::parse(trace.Json()));
  EXPECT_EQ(spans.size(), 4u);
  EXPECT_EQ(spans.at("3")["args"]["state"], "cancelled");
}

TEST(Trace, AnEmptyOneIsWholeAndIsWritten) {
  Trace trace;
  const auto path = std::filesystem::temp_directory_path() / ("rilievo-trace-" + std::to_string(::getpid()) + ".json");
  trace.Write(path);
  std::ifstream file(path);
  EXPECT_EQ(nlohmann::json::parse(file)["traceEvents"].size(), 1u);
  std::filesystem::remove(path);
}

}  // namespace
}  // namespace rilievo::engine
