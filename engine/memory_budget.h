// Accounting of declared memory: which task may start now, within a budget, without starving a lower one.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "engine/plan.h"

namespace rilievo::engine {

/// Pure bookkeeping, no threads. A running task is charged max(peak_bytes, retained_bytes); from its end until the last
/// task that needs its result has ended, retained_bytes. The rules (docs/decisions/0003-engine.md gives the reasons):
///
///  1. What is charged never exceeds the budget.
///  2. A task refused while lower than every other refused one is "first in line". Another task passes it only when the
///     first in line would still fit beside everything that passed it once the tasks that ran before have ended.
///  3. Ids are a topological order, so running them one by one in id order is always possible; `serial need` of a task
///  is
///     what would be charged then. A task that leaves a result behind runs ahead of the lowest unfinished one only
///     while the results so left plus the largest serial need still to come fit: so retained results cannot lock the
///     run up.
class MemoryBudget {
 public:
  /// budget_bytes 0 = unlimited.
  explicit MemoryBudget(std::uint64_t budget_bytes);

  /// Registers the tasks of the plan not seen yet. Tasks that grow the plan are registered before Finish of the task
  /// that grew it, so that a result they need is kept. A result already given up is not charged again. Amortised
  /// O(needs).
  void Register(const Plan& plan);

  /// Throws Error(kOutOfMemoryBudget) naming the lowest task that could not run even alone and in id order.
  void RefuseWhatNeverFits(const Plan& plan);

  /// Charges the task when it may start now. Tasks are to be tried in ascending id.
  bool TryAdmit(TaskId id);

  /// The task has ended; a task that was never admitted (skipped, cancelled) ends without success.
  void Finish(const Plan& plan, TaskId id, bool succeeded);

  /// True when the task is larger than the whole budget.
  bool IsTooLarge(TaskId id) const { return records_[id.value].charge_bytes > budget_bytes_; }

  /// One line for a task that does not fit: its need, the budget and what to change.
  std::string DescribeRefusal(const Task& task, std::uint64_t kept_bytes) const;

  std::uint64_t retained_bytes() const { return retained_bytes_; }
  std::uint64_t live_bytes() const { return live_bytes_; }
  std::uint64_t peak_live_bytes() const { return peak_live_bytes_; }

 private:
  struct Record {
    std::uint64_t charge_bytes = 0;
    std::uint64_t retained_bytes = 0;
    std::uint32_t consumers_left = 0;
    std::uint32_t last_consumer = 0;   ///< meaningful when the task ever had a consumer
    std::uint32_t passed_in_line = 0;  ///< which first in line it passed; 0 = none
    bool running = false, finished = false, kept = false, ahead = false;
  };

  struct SerialPeak {
    std::uint32_t task = 0;
    std::uint64_t need_bytes = 0, kept_bytes = 0;
  };
  SerialPeak FindSerialPeak(bool stop_at_first_over) const;
  bool MayRunAhead(TaskId id);
  bool DelaysFirstInLine(TaskId id) const;
  void StandFirstInLine(TaskId id);
  void GiveUpResult(Record& record);
  void AdvanceLowestUnfinished();

  static constexpr std::uint32_t kNobody = std::numeric_limits<std::uint32_t>::max();
  std::uint64_t budget_bytes_;
  std::vector<Record> records_;
  std::uint64_t live_bytes_ = 0, peak_live_bytes_ = 0, retained_bytes_ = 0;

  std::uint32_t first_in_line_ = kNobody;
  std::uint32_t line_number_ = 0;           ///< counts the tasks that stood first in line
  std::uint64_t passed_bytes_ = 0;          ///< charged by running tasks that passed the first in line
  std::uint64_t running_result_bytes_ = 0;  ///< retained_bytes of all running tasks
  std::uint64_t earlier_result_bytes_ = 0;  ///< results of the running tasks that did not pass it

  std::uint32_t lowest_unfinished_ = 0;
  std::uint64_t ahead_result_bytes_ = 0;  ///< results, kept or coming, of tasks above the lowest unfinished one
  std::uint64_t serial_peak_bytes_ = 0;   ///< upper bound of the serial needs still to come
  bool serial_peak_stale_ = true;         ///< the plan grew since it was computed
  std::size_t finished_since_peak_ = 0;
};

}  // namespace rilievo::engine
