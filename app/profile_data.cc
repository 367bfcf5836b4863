// The profile as JSON, and the page with the spans in it.
#include <map>
#include <utility>
#include <vector>

#include "app/profile_views.h"

namespace rilievo::app {
namespace {

using nlohmann::json;

json KnownOrNull(double value) { return value > 0 ? json(value) : json(nullptr); }

json StageJson(const engine::StageProfile& s) {
  return {{"name", s.name},
          {"tasks", s.tasks},
          {"reused", s.reused},
          {"failed", s.failed},
          {"start_s", s.start_s},
          {"end_s", s.end_s},
          {"wall_s", s.wall_s},
          {"worker_s", s.worker_s},
          {"cpu_s", s.cpu_s},
          {"units", s.units},
          {"unit", s.unit},
          {"units_per_s", s.units_per_s},
          {"cores", s.cores},
          {"share_of_machine", s.share_of_machine},
          {"critical_s", s.critical_s},
          {"read_bytes", s.read_bytes},
          {"written_bytes", s.written_bytes},
          {"planned_peak_bytes", s.planned_peak_bytes},
          {"resident_peak_bytes", s.resident_peak_bytes > 0 ? json(s.resident_peak_bytes) : json(nullptr)}};
}

json KernelJson(const engine::KernelProfile& k) {
  return {{"name", k.name},
          {"stage", k.stage},
          {"arithmetic", k.arithmetic == KernelName::Arithmetic::kBytes ? "bytes" : "floats"},
          {"multiply_adds", k.multiply_adds},
          {"cpu_s", k.cpu_s},
          {"rate_per_s", k.rate_per_s},
          {"peak_per_s", KnownOrNull(k.peak_per_s)},
          {"share_of_peak", KnownOrNull(k.share_of_peak)}};
}

json Curve(const std::vector<engine::MemorySample>& samples) {
  json curve = json::array();
  for (const auto& sample : samples) curve.push_back({sample.time_s, sample.bytes});
  return curve;
}

/// The spans as rows of numbers: a page of many tasks stays small.
json SpansJson(const engine::RecordedRun& run, const engine::RunProfile& profile) {
  std::map<std::string, std::size_t> stages;
  for (const auto& stage : profile.stages) stages.emplace(stage.name, stages.size());
  std::vector<bool> critical(run.tasks.size());
  for (const std::uint32_t i : profile.critical_path) critical[i] = true;
  json tasks = json::array(), helpers = json::array();
  for (std::size_t i = 0; i < run.tasks.size(); ++i) {
    const auto& t = run.tasks[i];
    tasks.push_back({t.name, stages.at(t.stage), t.span.worker, t.span.start_s, t.span.end_s, t.span.cpu_s,
                     t.span.read_bytes, t.span.written_bytes, t.peak_bytes, t.span.reused ? "reused" : t.state, t.units,
                     t.unit, critical[i]});
    for (const auto& h : t.span.helpers) helpers.push_back({i, h.worker, h.start_s, h.end_s});
  }
  return {{"tasks", std::move(tasks)}, {"helpers", std::move(helpers)}};
}

void ReplaceOnce(std::string& text, const std::string& what, const std::string& by) {
  if (const auto at = text.find(what); at != std::string::npos) text.replace(at, what.size(), by);
}

/// As it may stand in a page: text and script data alike.
std::string Escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '<')
      out += "&lt;";
    else if (c == '&')
      out += "&amp;";
    else
      out += c;
  }
  return out;
}

}  // namespace

json ProfileJson(const engine::RecordedRun& run, const engine::RunProfile& p) {
  json out = {{"format", "rilievo-profile"},
              {"version", 1},
              {"threads", p.threads},
              {"processor", run.facts.processor},
              {"wall_s", p.wall_s},
              {"before_s", p.before_s},
              {"worker_s", p.worker_s},
              {"cpu_s", p.cpu_s},
              {"busy_share", p.busy_share},
              {"cpu_share", p.cpu_share},
              {"idle_s", p.idle_s},
              {"memory",
               {{"allowed_bytes", run.facts.memory_bytes},
                {"overhead_bytes", run.facts.overhead_bytes},
                {"planned_peak_bytes", p.planned_peak_bytes},
                {"process_peak_bytes", p.resident_peak_bytes}}},
              {"stages", json::array()},
              {"kernels", json::array()},
              {"critical_path", {{"length_s", p.critical_s}, {"tasks", json::array()}}},
              {"gaps", json::array()}};
  for (const auto& stage : p.stages) out["stages"].push_back(StageJson(stage));
  for (const auto& kernel : p.kernels) out["kernels"].push_back(KernelJson(kernel));
  for (const std::uint32_t i : p.critical_path) out["critical_path"]["tasks"].push_back(run.tasks[i].name);
  for (const auto& gap : p.gaps)
    out["gaps"].push_back(
        {{"worker", gap.worker}, {"start_s", gap.start_s}, {"end_s", gap.end_s}, {"beside", gap.beside}});
  return out;
}

std::string ProfilePage(const engine::RecordedRun& run, const engine::RunProfile& profile, const std::string& title) {
  json data = ProfileJson(run, profile);
  data["spans"] = SpansJson(run, profile);
  data["curves"] = {{"planned", Curve(run.planned)}, {"resident", Curve(run.resident)}};
  std::string text = data.dump(-1, ' ', true, json::error_handler_t::replace);
  for (std::size_t at = 0; (at = text.find('<', at)) != std::string::npos;) text.replace(at, 1, "\\u003c");
  std::string page = kProfilePage;
  ReplaceOnce(page, "@TITLE@", Escaped(title));
  ReplaceOnce(page, "@TITLE@", Escaped(title));
  ReplaceOnce(page, "@DATA@", text);  // last: names of images may hold anything
  return page;
}

}  // namespace rilievo::app
