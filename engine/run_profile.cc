// Sums over tasks, the longest chain, and what no task covers.
#include "engine/run_profile.h"

#include <algorithm>
#include <map>
#include <utility>

namespace rilievo::engine {
namespace {

struct Interval {
  double start_s = 0, end_s = 0;
};

/// Sorted, without overlap.
std::vector<Interval> Union(std::vector<Interval> intervals) {
  std::sort(intervals.begin(), intervals.end(), [](const auto& a, const auto& b) {
    return a.start_s != b.start_s ? a.start_s < b.start_s : a.end_s < b.end_s;
  });
  std::vector<Interval> merged;
  for (const Interval& i : intervals) {
    if (merged.empty() || i.start_s > merged.back().end_s)
      merged.push_back(i);
    else
      merged.back().end_s = std::max(merged.back().end_s, i.end_s);
  }
  return merged;
}

double Length(const std::vector<Interval>& intervals) {
  double sum_s = 0;
  for (const Interval& i : intervals) sum_s += i.end_s - i.start_s;
  return sum_s;
}

double WorkerSeconds(const RecordedTask& task) {
  double sum_s = task.span.end_s - task.span.start_s;
  for (const HelperSpan& helper : task.span.helpers) sum_s += helper.end_s - helper.start_s;
  return sum_s;
}

/// The longest of the chains that end in each task; the chain itself by its predecessors.
struct Chains {
  std::vector<double> length_s;
  std::vector<std::size_t> before;  ///< index of the task before, or npos
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
};

Chains LongestChains(const RecordedRun& run) {
  Chains chains{std::vector<double>(run.tasks.size()), std::vector<std::size_t>(run.tasks.size(), Chains::kNone)};
  std::map<std::uint32_t, std::size_t> by_id;
  for (std::size_t i = 0; i < run.tasks.size(); ++i) {
    const RecordedTask& task = run.tasks[i];
    by_id[task.id] = i;
    double longest_s = 0;
    for (const std::uint32_t need : task.needs) {
      const auto found = by_id.find(need);
      if (found == by_id.end() || chains.length_s[found->second] <= longest_s) continue;
      longest_s = chains.length_s[found->second];
      chains.before[i] = found->second;
    }
    chains.length_s[i] = longest_s + (task.span.end_s - task.span.start_s);
  }
  return chains;
}

std::vector<std::uint32_t> CriticalPath(const Chains& chains) {
  std::vector<std::uint32_t> path;
  if (chains.length_s.empty()) return path;
  auto at = static_cast<std::size_t>(std::max_element(chains.length_s.begin(), chains.length_s.end()) -
                                     chains.length_s.begin());
  for (; at != Chains::kNone; at = chains.before[at]) path.push_back(static_cast<std::uint32_t>(at));
  std::reverse(path.begin(), path.end());
  return path;
}

class StageTable {
 public:
  explicit StageTable(const RecordedRun& run) {
    for (const RecordedTask& task : run.tasks) Add(task);
    for (std::size_t s = 0; s < stages.size(); ++s) Complete(run, s);
  }

  std::vector<StageProfile> stages;
  std::map<std::string, std::size_t> index;

 private:
  void Add(const RecordedTask& task) {
    const auto [at, is_new] = index.try_emplace(task.stage, stages.size());
    if (is_new) {
      stages.push_back({.name = task.stage, .start_s = task.span.start_s, .unit = {}});
      spans_.emplace_back();
    }
    StageProfile& stage = stages[at->second];
    spans_[at->second].push_back({task.span.start_s, task.span.end_s});
    ++stage.tasks;
    stage.reused += task.span.reused ? 1 : 0;
    stage.failed += task.state == "failed" ? 1 : 0;
    stage.start_s = std::min(stage.start_s, task.span.start_s);
    stage.end_s = std::max(stage.end_s, task.span.end_s);
    stage.worker_s += WorkerSeconds(task);
    stage.cpu_s += task.span.cpu_s;
    if (!task.unit.empty()) stage.unit = task.unit;
    if (!task.span.reused && task.state == "done") stage.units += task.units;
    stage.read_bytes += task.span.read_bytes;
    stage.written_bytes += task.span.written_bytes;
    stage.planned_peak_bytes = std::max({stage.planned_peak_bytes, task.peak_bytes, task.retained_bytes});
  }

  void Complete(const RecordedRun& run, std::size_t s) {
    StageProfile& stage = stages[s];
    const std::vector<Interval> spans = Union(std::move(spans_[s]));
    stage.wall_s = Length(spans);
    if (stage.wall_s > 0) {
      stage.units_per_s = stage.units / stage.wall_s;
      stage.cores = stage.cpu_s / stage.wall_s;
    }
    // A sample holds the largest since the one before it.
    double from_s = 0;
    auto span = spans.begin();
    for (const MemorySample& sample : run.resident) {
      while (span != spans.end() && span->end_s < from_s) ++span;
      if (span != spans.end() && span->start_s <= sample.time_s)
        stage.resident_peak_bytes = std::max(stage.resident_peak_bytes, sample.bytes);
      from_s = sample.time_s;
    }
  }

  std::vector<std::vector<Interval>> spans_;
};

std::vector<KernelProfile> Kernels(const RecordedRun& run, const MachinePeak& peak) {
  std::map<std::pair<std::string, std::string>, KernelProfile> sums;
  for (const RecordedTask& task : run.tasks) {
    for (const RecordedKernel& kernel : task.kernels) {
      KernelProfile& sum = sums[{task.stage, kernel.name}];
      sum.name = kernel.name;
      sum.stage = task.stage;
      sum.arithmetic = kernel.arithmetic;
      sum.multiply_adds += kernel.multiply_adds;
      sum.cpu_s += kernel.cpu_s;
    }
  }
  std::vector<KernelProfile> kernels;
  for (auto& [key, kernel] : sums) {
    kernel.peak_per_s = kernel.arithmetic == KernelName::Arithmetic::kBytes ? peak.bytes_per_s : peak.floats_per_s;
    if (kernel.cpu_s > 0) kernel.rate_per_s = kernel.multiply_adds / kernel.cpu_s;
    if (kernel.peak_per_s > 0) kernel.share_of_peak = kernel.rate_per_s / kernel.peak_per_s;
    kernels.push_back(std::move(kernel));
  }
  return kernels;
}

/// The task that shares most of the time of the gap.
std::string RanBeside(const RecordedRun& run, const IdleGap& gap) {
  double most_s = 0;
  std::string name;
  for (const RecordedTask& task : run.tasks) {
    const double shared_s = std::min(gap.end_s, task.span.end_s) - std::max(gap.start_s, task.span.start_s);
    if (shared_s <= most_s) continue;
    most_s = shared_s;
    name = task.name;
  }
  return name;
}

/// Workers as they are: a run of few tasks may not use all, so that a worker may be idle from the beginning to the end.
std::vector<IdleGap> IdleGaps(const RecordedRun& run, int threads, double wall_s) {
  std::map<int, std::vector<Interval>> busy;
  for (int worker = 0; worker < threads; ++worker) busy[worker];
  for (const RecordedTask& task : run.tasks) {
    busy[task.span.worker].push_back({task.span.start_s, task.span.end_s});
    for (const HelperSpan& helper : task.span.helpers) busy[helper.worker].push_back({helper.start_s, helper.end_s});
  }
  std::vector<IdleGap> gaps;
  for (auto& [worker, spans] : busy) {
    double free_s = 0;
    spans.push_back({wall_s, wall_s});
    for (const Interval& span : Union(std::move(spans))) {
      if (span.start_s > free_s) gaps.push_back({worker, free_s, span.start_s, {}});
      free_s = std::max(free_s, span.end_s);
    }
  }
  std::stable_sort(gaps.begin(), gaps.end(),
                   [](const auto& a, const auto& b) { return a.end_s - a.start_s > b.end_s - b.start_s; });
  return gaps;
}

}  // namespace

RunProfile ProfileOf(const RecordedRun& run, const MachinePeak& peak) {
  constexpr std::size_t kMostGaps = 10;
  RunProfile profile;
  profile.before_s = run.facts.before_s;
  profile.threads = run.facts.threads;
  profile.resident_peak_bytes = run.process_peak_bytes;
  for (const MemorySample& sample : run.planned)
    profile.planned_peak_bytes = std::max(profile.planned_peak_bytes, sample.bytes);
  for (const RecordedTask& task : run.tasks) {
    profile.threads = std::max(profile.threads, task.span.worker + 1);
    profile.wall_s = std::max(profile.wall_s, task.span.end_s);
    profile.cpu_s += task.span.cpu_s;
  }
  StageTable table(run);
  const Chains chains = LongestChains(run);
  profile.critical_path = CriticalPath(chains);
  for (const std::uint32_t i : profile.critical_path) {
    const RecordedTask& task = run.tasks[i];
    profile.critical_s += task.span.end_s - task.span.start_s;
    table.stages[table.index.at(task.stage)].critical_s += task.span.end_s - task.span.start_s;
  }
  profile.gaps = IdleGaps(run, profile.threads, profile.wall_s);
  for (const IdleGap& gap : profile.gaps) profile.idle_s += gap.end_s - gap.start_s;
  profile.gaps.resize(std::min(profile.gaps.size(), kMostGaps));
  for (IdleGap& gap : profile.gaps) gap.beside = RanBeside(run, gap);
  const double capacity_s = profile.threads * profile.wall_s;
  profile.worker_s = capacity_s - profile.idle_s;
  if (capacity_s > 0) {
    profile.busy_share = profile.worker_s / capacity_s;
    profile.cpu_share = profile.cpu_s / capacity_s;
    for (StageProfile& stage : table.stages) stage.share_of_machine = stage.cpu_s / capacity_s;
  }
  profile.stages = std::move(table.stages);
  std::stable_sort(profile.stages.begin(), profile.stages.end(),
                   [](const auto& a, const auto& b) { return a.start_s < b.start_s; });
  profile.kernels = Kernels(run, peak);
  return profile;
}

}  // namespace rilievo::engine
