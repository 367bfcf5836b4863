// What a task is declared to need before it runs.
#pragma once

#include <cstdint>

namespace rilievo {

/// `peak_bytes`: upper bound of the memory the task holds while it runs. `work`: relative CPU effort, about seconds
/// on one core of a current laptop; used for order, progress and time estimates, never for results.
struct TaskCost {
  std::uint64_t peak_bytes = 0;
  double work = 0;
};

}  // namespace rilievo
