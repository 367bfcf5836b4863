// A run as its trace file tells of it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "engine/memory_curve.h"
#include "engine/trace.h"

namespace rilievo::engine {

struct RecordedKernel {
  std::string name;
  KernelName::Arithmetic arithmetic = KernelName::Arithmetic::kFloats;
  double multiply_adds = 0, cpu_s = 0;
};

struct RecordedTask {
  std::uint32_t id = 0;
  std::string name, stage, state, error, unit;
  TaskSpan span;  ///< its kernels are below, with names of their own
  std::vector<RecordedKernel> kernels;
  std::vector<std::uint32_t> needs;
  std::uint64_t peak_bytes = 0, retained_bytes = 0;
  double units = 0;
};

struct RecordedRun {
  RunFacts facts;
  std::uint64_t process_peak_bytes = 0;  ///< resident, of the whole process; 0 = not recorded
  std::vector<RecordedTask> tasks;       ///< that started, by id
  std::vector<MemorySample> planned;     ///< declared bytes from that time on
  std::vector<MemorySample> resident;    ///< largest since the sample before
};

/// Reads a file of Trace::Write (docs/formats/trace.md). Throws Error(kNotFound / kUnreadable / kInvalidInput), and
/// Error(kVersion) for a newer format. A trace of before the format had a version lacks processor times and kernels.
RecordedRun ReadTrace(const std::filesystem::path& path);

}  // namespace rilievo::engine
