// The admission rules of MemoryBudget.
#include "engine/memory_budget.h"

#include <algorithm>

#include "base/check.h"
#include "base/error.h"
#include "base/units.h"

namespace rilievo::engine {

MemoryBudget::MemoryBudget(std::uint64_t budget_bytes)
    : budget_bytes_(budget_bytes == 0 ? std::numeric_limits<std::uint64_t>::max() : budget_bytes) {}

void MemoryBudget::Register(const Plan& plan) {
  for (auto i = static_cast<std::uint32_t>(records_.size()); i < plan.size(); ++i) {
    const Task& task = plan.task(TaskId(i));
    Record record;
    record.charge_bytes = std::max(task.cost.peak_bytes, task.retained_bytes);
    record.retained_bytes = task.retained_bytes;
    for (const TaskId need : task.needs) {
      ++records_[need.value].consumers_left;
      records_[need.value].last_consumer = i;
    }
    records_.push_back(record);
    serial_peak_stale_ = true;
  }
}

MemoryBudget::SerialPeak MemoryBudget::FindSerialPeak(bool stop_at_first_over) const {
  std::uint64_t kept_bytes = 0;
  std::vector<std::uint64_t> given_up(records_.size(), 0);  // at the end of task i, results last needed by it
  const auto keep = [&](const Record& record) {
    kept_bytes += record.retained_bytes;
    given_up[record.last_consumer] += record.retained_bytes;
  };
  for (std::uint32_t i = 0; i < lowest_unfinished_; ++i)
    if (records_[i].kept && records_[i].last_consumer >= lowest_unfinished_) keep(records_[i]);
  SerialPeak peak;
  for (std::uint32_t i = lowest_unfinished_; i < records_.size(); ++i) {
    const Record& record = records_[i];
    const bool larger = !record.finished && kept_bytes + record.charge_bytes > peak.need_bytes;
    if (larger) peak = {i, kept_bytes + record.charge_bytes, kept_bytes};
    if (stop_at_first_over && peak.need_bytes > budget_bytes_) return peak;
    if (record.last_consumer > i) keep(record);
    kept_bytes -= given_up[i];
  }
  return peak;
}

void MemoryBudget::RefuseWhatNeverFits(const Plan& plan) {
  const SerialPeak peak = FindSerialPeak(true);
  serial_peak_bytes_ = peak.need_bytes;
  serial_peak_stale_ = false;
  finished_since_peak_ = 0;
  if (peak.need_bytes <= budget_bytes_) return;
  const Task& task = plan.task(TaskId(peak.task));
  throw Error(ErrorCode::kOutOfMemoryBudget, "", DescribeRefusal(task, peak.kept_bytes), task.memory_hint);
}

std::string MemoryBudget::DescribeRefusal(const Task& task, std::uint64_t kept_bytes) const {
  std::string line = "task " + task.name + " needs " + FormatBytes(std::max(task.cost.peak_bytes, task.retained_bytes));
  if (kept_bytes > 0) line += " beside " + FormatBytes(kept_bytes) + " of results kept for later tasks";
  return line + ", more than the memory budget of " + FormatBytes(budget_bytes_);
}

bool MemoryBudget::MayRunAhead(TaskId id) {
  const Record& record = records_[id.value];
  if (id.value == lowest_unfinished_ || record.retained_bytes == 0) return true;
  const auto fits = [&] {
    return serial_peak_bytes_ <= budget_bytes_ &&
           ahead_result_bytes_ + record.retained_bytes <= budget_bytes_ - serial_peak_bytes_;
  };
  // The peak only falls while tasks end; looking again is linear, hence only after a share of the plan has ended.
  const bool worth_a_look = finished_since_peak_ > records_.size() / 16;
  if (serial_peak_stale_ || (worth_a_look && !fits())) {
    serial_peak_bytes_ = FindSerialPeak(false).need_bytes;
    serial_peak_stale_ = false;
    finished_since_peak_ = 0;
  }
  return fits();
}

bool MemoryBudget::DelaysFirstInLine(TaskId id) const {
  const Record& record = records_[id.value];
  if (first_in_line_ == kNobody || id.value <= first_in_line_ || record.charge_bytes == 0) return false;
  const std::uint64_t beside = retained_bytes_ + earlier_result_bytes_ + passed_bytes_ + record.charge_bytes;
  return beside > budget_bytes_ || records_[first_in_line_].charge_bytes > budget_bytes_ - beside;
}

void MemoryBudget::StandFirstInLine(TaskId id) {
  if (id.value >= first_in_line_) return;
  first_in_line_ = id.value;
  ++line_number_;
  passed_bytes_ = 0;
  earlier_result_bytes_ = running_result_bytes_;
}

bool MemoryBudget::TryAdmit(TaskId id) {
  Record& record = records_[id.value];
  RILIEVO_CHECK(!record.running && !record.finished);
  if (record.charge_bytes > budget_bytes_ - live_bytes_) {
    StandFirstInLine(id);
    return false;
  }
  if (DelaysFirstInLine(id) || !MayRunAhead(id)) return false;
  if (id.value == first_in_line_) first_in_line_ = kNobody;
  const bool passes = first_in_line_ != kNobody && id.value > first_in_line_;
  record.passed_in_line = passes ? line_number_ : 0;
  if (passes)
    passed_bytes_ += record.charge_bytes;
  else
    earlier_result_bytes_ += record.retained_bytes;
  record.running = true;
  running_result_bytes_ += record.retained_bytes;
  live_bytes_ += record.charge_bytes;
  peak_live_bytes_ = std::max(peak_live_bytes_, live_bytes_);
  if (id.value > lowest_unfinished_ && record.retained_bytes > 0) {
    record.ahead = true;
    ahead_result_bytes_ += record.retained_bytes;
  }
  return true;
}

void MemoryBudget::GiveUpResult(Record& record) {
  record.kept = false;
  live_bytes_ -= record.retained_bytes;
  retained_bytes_ -= record.retained_bytes;
  if (record.ahead) ahead_result_bytes_ -= record.retained_bytes;
  record.ahead = false;
}

void MemoryBudget::Finish(const Plan& plan, TaskId id, bool succeeded) {
  Record& record = records_[id.value];
  RILIEVO_CHECK(!record.finished);
  record.finished = true;
  ++finished_since_peak_;
  if (record.running) {
    record.running = false;
    running_result_bytes_ -= record.retained_bytes;
    live_bytes_ -= record.charge_bytes;
    if (record.passed_in_line != 0 && record.passed_in_line == line_number_)
      passed_bytes_ -= record.charge_bytes;
    else
      earlier_result_bytes_ -= record.retained_bytes;
    record.kept = true;  // for a moment, when nobody needs it
    live_bytes_ += record.retained_bytes;
    retained_bytes_ += record.retained_bytes;
    if (!succeeded || record.consumers_left == 0) GiveUpResult(record);
  }
  if (id.value == first_in_line_) first_in_line_ = kNobody;
  for (const TaskId need : plan.task(id).needs) {
    Record& needed = records_[need.value];
    if (--needed.consumers_left == 0 && needed.kept) GiveUpResult(needed);
  }
  AdvanceLowestUnfinished();
}

void MemoryBudget::AdvanceLowestUnfinished() {
  while (lowest_unfinished_ < records_.size() && records_[lowest_unfinished_].finished) {
    Record& record = records_[lowest_unfinished_++];
    if (record.ahead) ahead_result_bytes_ -= record.retained_bytes;
    record.ahead = false;
  }
  // A running task that has become the lowest one is no longer ahead.
  if (lowest_unfinished_ < records_.size() && records_[lowest_unfinished_].ahead) {
    ahead_result_bytes_ -= records_[lowest_unfinished_].retained_bytes;
    records_[lowest_unfinished_].ahead = false;
  }
}

}  // namespace rilievo::engine
