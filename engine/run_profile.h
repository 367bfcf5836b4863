// Where the time, the bytes and the memory of a run went.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "engine/recorded_run.h"

namespace rilievo::engine {

/// Times are seconds since the run began; a task that was reused counts among the tasks and in times and bytes, not in
/// units.
struct StageProfile {
  std::string name;
  std::size_t tasks = 0, reused = 0, failed = 0;
  double start_s = 0, end_s = 0;
  double wall_s = 0;            ///< while at least one task of it ran
  double worker_s = 0;          ///< its tasks and their helpers, all workers together
  double cpu_s = 0;             ///< processor time
  double units = 0;             ///< computed
  std::string unit;             ///< "Mpx", "pairs"; empty = none
  double units_per_s = 0;       ///< over wall_s
  double cores = 0;             ///< cpu_s / wall_s
  double share_of_machine = 0;  ///< cpu_s over threads times the run's wall time
  double critical_s = 0;        ///< its part of the critical path
  std::uint64_t read_bytes = 0, written_bytes = 0;
  std::uint64_t planned_peak_bytes = 0;   ///< largest declared peak of a task
  std::uint64_t resident_peak_bytes = 0;  ///< largest of the whole process while it ran; 0 = not recorded
};

struct KernelProfile {
  std::string name, stage;
  KernelName::Arithmetic arithmetic = KernelName::Arithmetic::kFloats;
  double multiply_adds = 0, cpu_s = 0;
  double rate_per_s = 0;     ///< multiply-adds a second of processor time
  double peak_per_s = 0;     ///< of one core; 0 = not known
  double share_of_peak = 0;  ///< 0 = not known
};

/// A worker without work between two moments.
struct IdleGap {
  int worker = 0;
  double start_s = 0, end_s = 0;
  std::string beside;  ///< what ran longest on another worker meanwhile; empty = nothing
};

struct RunProfile {
  int threads = 0;
  double wall_s = 0;
  double before_s = 0;  ///< from the program's start to the run's
  double worker_s = 0;  ///< busy, all workers together
  double cpu_s = 0;
  double busy_share = 0;                     ///< worker_s over threads times wall_s
  double cpu_share = 0;                      ///< the same of cpu_s
  double idle_s = 0;                         ///< all workers together
  double critical_s = 0;                     ///< of the longest chain of tasks that need one another
  std::vector<std::uint32_t> critical_path;  ///< indices into the run's tasks, first to last
  std::vector<StageProfile> stages;          ///< in the order in which they began
  std::vector<KernelProfile> kernels;        ///< by stage and name
  std::vector<IdleGap> gaps;                 ///< the longest first, at most ten
  std::uint64_t planned_peak_bytes = 0, resident_peak_bytes = 0;
};

/// Peaks of the machine that the run was on, a second and core; 0 = not known.
struct MachinePeak {
  double bytes_per_s = 0, floats_per_s = 0;
};

RunProfile ProfileOf(const RecordedRun& run, const MachinePeak& peak);

}  // namespace rilievo::engine
