// Parses trace files.
#include "engine/recorded_run.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "base/error.h"

namespace rilievo::engine {
namespace {

using nlohmann::json;

constexpr int kVersion = 1;

RecordedKernel KernelFrom(const std::string& name, const json& in) {
  return {name, in.at("arithmetic") == "bytes" ? KernelName::Arithmetic::kBytes : KernelName::Arithmetic::kFloats,
          in.at("multiply_adds"), in.at("cpu_s")};
}

RecordedTask TaskFrom(const json& event) {
  const json& args = event.at("args");
  RecordedTask task;
  task.id = args.at("task");
  task.name = event.at("name");
  task.stage = args.at("stage");
  task.state = args.at("state");
  task.error = args.value("error", "");
  task.unit = args.value("unit", "");
  task.units = args.value("units", 0.0);
  task.needs = args.value("needs", std::vector<std::uint32_t>{});
  task.peak_bytes = args.at("peak_bytes");
  task.retained_bytes = args.at("retained_bytes");
  task.span.task = TaskId(task.id);
  task.span.worker = event.at("tid");
  task.span.start_s = 1e-6 * event.at("ts").get<double>();
  task.span.end_s = task.span.start_s + 1e-6 * event.at("dur").get<double>();
  task.span.cpu_s = args.value("cpu_s", 0.0);
  task.span.read_bytes = args.at("read_bytes");
  task.span.written_bytes = args.at("written_bytes");
  task.span.reused = args.at("reused");
  if (const auto kernels = args.find("kernels"); kernels != args.end())
    for (const auto& [name, use] : kernels->items()) task.kernels.push_back(KernelFrom(name, use));
  return task;
}

RunFacts FactsFrom(const json& in) {
  RunFacts facts;
  facts.threads = in.value("threads", 0);
  facts.memory_bytes = in.value("memory_bytes", std::uint64_t{0});
  facts.overhead_bytes = in.value("overhead_bytes", std::uint64_t{0});
  facts.before_s = in.value("before_s", 0.0);
  facts.processor = in.value("processor", "");
  return facts;
}

void AddEvent(const json& event, RecordedRun& run, std::map<std::uint32_t, std::vector<HelperSpan>>& helpers) {
  const std::string kind = event.at("ph");
  const double time_s = 1e-6 * event.value("ts", 0.0);
  if (kind == "X" && event.at("cat") == "loop") {
    helpers[event.at("args").at("helps")].push_back(
        {event.at("tid"), time_s, time_s + 1e-6 * event.at("dur").get<double>()});
  } else if (kind == "X") {
    run.tasks.push_back(TaskFrom(event));
  } else if (kind == "C") {
    auto& curve = event.at("name") == "resident bytes" ? run.resident : run.planned;
    curve.push_back({time_s, event.at("args").at("bytes")});
  }
}

}  // namespace

RecordedRun ReadTrace(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file)
    throw Error(std::filesystem::exists(path) ? ErrorCode::kUnreadable : ErrorCode::kNotFound, path.string(),
                "there is no trace that can be read", "give a workspace in which orient ran, or a file of --trace");
  RecordedRun run;
  try {
    const json in = json::parse(file);
    const json facts = in.value("otherData", json::object());
    if (facts.value("version", kVersion) > kVersion)
      throw Error(ErrorCode::kVersion, path.string(), "is a trace of a newer program", "use the program that wrote it");
    run.facts = FactsFrom(facts);
    run.process_peak_bytes = facts.value("process_peak_bytes", std::uint64_t{0});
    std::map<std::uint32_t, std::vector<HelperSpan>> helpers;
    for (const json& event : in.at("traceEvents")) AddEvent(event, run, helpers);
    for (RecordedTask& task : run.tasks)
      if (const auto found = helpers.find(task.id); found != helpers.end())
        task.span.helpers = std::move(found->second);
  } catch (const json::exception&) {
    throw Error(ErrorCode::kInvalidInput, path.string(), "is no trace of this program, or a damaged one",
                "give a workspace in which orient ran, or a file of --trace");
  }
  std::sort(run.tasks.begin(), run.tasks.end(), [](const auto& a, const auto& b) { return a.id < b.id; });
  return run;
}

}  // namespace rilievo::engine
