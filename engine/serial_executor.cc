// The reference executor: ids are a topological order, so "always the lowest ready task" is a loop over the plan.
#include "base/check.h"
#include "base/error.h"
#include "engine/executor.h"
#include "engine/memory_budget.h"
#include "engine/task_run.h"

namespace rilievo::engine {
namespace {

class SerialTaskRun : public TaskRun {
 public:
  SerialTaskRun(const ExecutionOptions& options, const RunClock& clock, TaskId id, const Task& task)
      : TaskRun(options, clock), observers_(options.observers), id_(id), task_(task) {}
  void ParallelFor(std::size_t n, std::size_t grain, const std::function<void(std::size_t, std::size_t)>& fn) override {
    RILIEVO_CHECK(grain > 0);
    for (std::size_t begin = 0; begin < n; begin += grain) fn(begin, n - begin > grain ? begin + grain : n);
  }
  void ReportProgress(double fraction) override {
    for (Observer* observer : observers_) observer->OnTaskProgress(id_, task_, fraction);
  }

 private:
  const std::vector<Observer*>& observers_;
  TaskId id_;
  const Task& task_;
};

class SerialRun {
 public:
  SerialRun(Plan& plan, const ExecutionOptions& options)
      : plan_(plan), options_(options), budget_(options.memory_bytes) {
    budget_.Register(plan_);
    budget_.RefuseWhatNeverFits(plan_);
  }

  ExecutionReport Run() {
    TellAdded();
    for (std::uint32_t i = 0; i < plan_.size(); ++i) RunOne(TaskId(i));
    report_.peak_live_bytes = budget_.peak_live_bytes();
    return std::move(report_);
  }

 private:
  void TellAdded() {
    while (report_.outcomes.size() < plan_.size()) {
      const TaskId id(static_cast<std::uint32_t>(report_.outcomes.size()));
      report_.outcomes.emplace_back();
      for (Observer* observer : options_.observers) observer->OnTaskAdded(id, plan_.task(id));
    }
  }

  TaskOutcome Run(TaskId id, const Task& task, TaskSpan& span) {
    for (Observer* observer : options_.observers) observer->OnTaskStarted(id, task, 0);
    SerialTaskRun run(options_, clock_, id, task);
    TaskOutcome outcome = run.Execute(task);
    run.CompleteSpan(span);
    if (outcome.state == TaskState::kDone) {
      const std::size_t old_size = GrowPlan(plan_, id, run.TakeGrows(), outcome);
      budget_.Register(plan_);
      TellAdded();
      if (outcome.state != TaskState::kDone)
        for (std::size_t i = old_size; i < plan_.size(); ++i) report_.outcomes[i].state = TaskState::kSkipped;
    }
    span.reused = outcome.reused;
    return outcome;
  }

  /// The outcome of a task that is not run, or kPending.
  TaskOutcome WithoutRunning(TaskId id, const Task& task) {
    TaskOutcome outcome = report_.outcomes[id.value];
    if (outcome.state != TaskState::kPending) return outcome;
    bool cancelled = false;
    for (const TaskId need : task.needs) {
      const TaskState state = report_.outcomes[need.value].state;
      if (state == TaskState::kFailed || state == TaskState::kSkipped) outcome.state = TaskState::kSkipped;
      cancelled |= state == TaskState::kCancelled;
    }
    if (outcome.state == TaskState::kSkipped) return outcome;
    if (cancelled || (options_.stop != nullptr && options_.stop->StopRequested())) {
      outcome.state = TaskState::kCancelled;
    } else if (!budget_.TryAdmit(id)) {
      outcome.state = TaskState::kFailed;
      outcome.error = Error(ErrorCode::kOutOfMemoryBudget, "", budget_.DescribeRefusal(task, budget_.retained_bytes()),
                            task.memory_hint)
                          .what();
    }
    return outcome;
  }

  void RunOne(TaskId id) {
    const Task& task = plan_.task(id);
    TaskSpan span{.task = id};
    TaskOutcome outcome = WithoutRunning(id, task);
    span.start_s = span.end_s = clock_.Now_s();
    if (outcome.state == TaskState::kPending) outcome = Run(id, task, span);
    budget_.Finish(plan_, id, outcome.state == TaskState::kDone);
    CountOutcome(outcome, report_);
    report_.outcomes[id.value] = outcome;
    for (Observer* observer : options_.observers) observer->OnTaskFinished(id, task, outcome, span);
  }

  Plan& plan_;
  const ExecutionOptions& options_;
  MemoryBudget budget_;
  ExecutionReport report_;
  RunClock clock_;
};

class SerialExecutor : public Executor {
 public:
  ExecutionReport Run(Plan& plan, const ExecutionOptions& options) override { return SerialRun(plan, options).Run(); }
};

}  // namespace

std::unique_ptr<Executor> MakeSerialExecutor() { return std::make_unique<SerialExecutor>(); }

}  // namespace rilievo::engine
