// The profile as tables of text.
#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "app/profile_views.h"
#include "base/units.h"

namespace rilievo::app {
namespace {

std::string Percent(double share) { return fmt::format("{:.0f} %", 100 * share); }

/// Hundredths where FormatDuration has tenths: small stages have times, too.
std::string Seconds(double time_s) { return time_s < 60 ? fmt::format("{:.2f} s", time_s) : FormatDuration(time_s); }

std::string BytesOrDash(std::uint64_t bytes) { return bytes == 0 ? "-" : FormatBytes(bytes); }

std::string Rate(const engine::StageProfile& stage) {
  if (stage.unit.empty() || stage.units <= 0) return "-";
  return fmt::format("{:.3g} {}/s", stage.units_per_s, stage.unit);
}

void AddStages(const engine::RunProfile& profile, std::string& text) {
  auto out = std::back_inserter(text);
  fmt::format_to(out, "\n{:<12} {:>6} {:>6} {:>9} {:>14} {:>9} {:>6} {:>8} {:>9} {:>10} {:>10} {:>10} {:>10}\n",
                 "stage", "tasks", "reused", "wall", "rate", "CPU", "cores", "machine", "critical", "read", "written",
                 "planned", "resident");
  for (const auto& s : profile.stages)
    fmt::format_to(out, "{:<12} {:>6} {:>6} {:>9} {:>14} {:>9} {:>6.2f} {:>8} {:>9} {:>10} {:>10} {:>10} {:>10}\n",
                   s.name, s.tasks, s.reused, Seconds(s.wall_s), Rate(s), Seconds(s.cpu_s), s.cores,
                   Percent(s.share_of_machine), Seconds(s.critical_s), BytesOrDash(s.read_bytes),
                   BytesOrDash(s.written_bytes), BytesOrDash(s.planned_peak_bytes), BytesOrDash(s.resident_peak_bytes));
  fmt::format_to(out,
                 "  wall: while a task of the stage ran; cores: CPU / wall; machine: CPU of all that the threads had;\n"
                 "  planned: largest task as declared; resident: most that the whole process held meanwhile\n");
}

void AddKernels(const engine::RunProfile& profile, std::string& text) {
  if (profile.kernels.empty()) return;
  auto out = std::back_inserter(text);
  fmt::format_to(out, "\n{:<12} {:<12} {:>9} {:>14} {:>14} {:>8}\n", "kernel", "stage", "CPU", "rate", "machine's peak",
                 "share");
  for (const auto& k : profile.kernels) {
    const bool known = k.peak_per_s > 0;
    fmt::format_to(out, "{:<12} {:<12} {:>9} {:>14} {:>14} {:>8}\n", k.name, k.stage, Seconds(k.cpu_s),
                   fmt::format("{:.1f} GMAC/s", 1e-9 * k.rate_per_s),
                   known ? fmt::format("{:.1f} GMAC/s", 1e-9 * k.peak_per_s) : "not known",
                   known ? Percent(k.share_of_peak) : "-");
  }
  fmt::format_to(out, "  multiply-adds a second of processor time, on one core; the scale space is sampled\n");
}

void AddCriticalPath(const engine::RecordedRun& run, const engine::RunProfile& profile, std::string& text) {
  constexpr std::size_t kShown = 5;
  auto out = std::back_inserter(text);
  fmt::format_to(out, "\ncritical path  {} of {} wall: {} tasks that had to follow one another; the longest:\n",
                 Seconds(profile.critical_s), Seconds(profile.wall_s), profile.critical_path.size());
  std::vector<std::uint32_t> longest = profile.critical_path;
  const auto length_s = [&](std::uint32_t i) { return run.tasks[i].span.end_s - run.tasks[i].span.start_s; };
  std::stable_sort(longest.begin(), longest.end(), [&](auto a, auto b) { return length_s(a) > length_s(b); });
  for (std::size_t i = 0; i < std::min(kShown, longest.size()); ++i)
    fmt::format_to(out, "  {:>9}  {}\n", Seconds(length_s(longest[i])), run.tasks[longest[i]].name);
}

void AddGaps(const engine::RunProfile& profile, std::string& text) {
  constexpr std::size_t kShown = 5;
  auto out = std::back_inserter(text);
  fmt::format_to(out, "\nidle           {} of all workers together{}\n", Seconds(profile.idle_s),
                 profile.gaps.empty() ? "" : "; the longest gaps:");
  for (std::size_t i = 0; i < std::min(kShown, profile.gaps.size()); ++i) {
    const auto& gap = profile.gaps[i];
    fmt::format_to(out, "  {:>9}  worker {} from {:.2f} s to {:.2f} s{}\n", Seconds(gap.end_s - gap.start_s),
                   gap.worker, gap.start_s, gap.end_s, gap.beside.empty() ? "" : ", beside '" + gap.beside + "'");
  }
}

}  // namespace

std::string ProfileText(const engine::RecordedRun& run, const engine::RunProfile& profile) {
  std::string text;
  auto out = std::back_inserter(text);
  fmt::format_to(out, "wall time      {} on {} threads, after {} of reading headers and digests\n",
                 Seconds(profile.wall_s), profile.threads, Seconds(profile.before_s));
  fmt::format_to(out, "workers        {} busy; processor time {} ({} of the cores)\n", Percent(profile.busy_share),
                 Seconds(profile.cpu_s), Percent(profile.cpu_share));
  fmt::format_to(out, "memory         planned {} at most, allowed {}; process {} at most\n",
                 FormatBytes(profile.planned_peak_bytes), BytesOrDash(run.facts.memory_bytes),
                 BytesOrDash(profile.resident_peak_bytes));
  if (!run.facts.processor.empty()) fmt::format_to(out, "processor      {}\n", run.facts.processor);
  AddStages(profile, text);
  AddKernels(profile, text);
  AddCriticalPath(run, profile, text);
  AddGaps(profile, text);
  return text;
}

}  // namespace rilievo::app
