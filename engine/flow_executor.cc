// The parallel executor: a oneTBB flow graph of a worker node and a serial scheduler node that exchange task ids.
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/concurrent_vector.h>
#include <oneapi/tbb/flow_graph.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <exception>
#include <tuple>
#include <utility>

#include "base/check.h"
#include "base/error.h"
#include "engine/executor.h"
#include "engine/memory_budget.h"
#include "engine/ready_queue.h"
#include "engine/task_run.h"

namespace rilievo::engine {
namespace {

namespace flow = oneapi::tbb::flow;

/// What travels to the scheduler: an id and what happened to it.
struct Event {
  enum class Kind : std::uint8_t { kBegin, kStarted, kProgress, kFinished };
  TaskId id;
  Kind kind = Kind::kBegin;
};

/// What a worker leaves for the scheduler; it stays at its address while others are added.
struct Slot {
  const Task* task = nullptr;
  TaskOutcome outcome;
  TaskSpan span;
  std::vector<std::function<void(Plan&)>> grows;
  std::atomic<float> fraction{0};
};

using SchedulerNode = flow::multifunction_node<Event, std::tuple<TaskId>, flow::queueing_lightweight>;
using WorkerNode = flow::function_node<TaskId, Event>;

class FlowTaskRun : public TaskRun {
 public:
  FlowTaskRun(const ExecutionOptions& options, const RunClock& clock, TaskId id, Slot& slot, SchedulerNode& scheduler)
      : TaskRun(options, clock), observed_(!options.observers.empty()), id_(id), slot_(slot), scheduler_(scheduler) {}

  /// Isolated: a thread that waits here takes parts of this loop only, never another task, whose memory would then be
  /// held twice by one thread and whose time would count as this task's.
  void ParallelFor(std::size_t n, std::size_t grain, const std::function<void(std::size_t, std::size_t)>& fn) override {
    RILIEVO_CHECK(grain > 0);
    if (n == 0) return;
    const std::size_t ranges = (n - 1) / grain + 1;
    loops_.fetch_add(1, std::memory_order_relaxed);
    const struct Leave {
      std::atomic<int>& loops;
      ~Leave() { loops.fetch_sub(1, std::memory_order_relaxed); }
    } leave{loops_};
    const KernelName* const kernel = CurrentKernel();
    oneapi::tbb::this_task_arena::isolate([&] {
      oneapi::tbb::parallel_for(oneapi::tbb::blocked_range<std::size_t>(0, ranges), [&](const auto& part) {
        RunPart(kernel, oneapi::tbb::this_task_arena::current_thread_index(), [&] {
          for (std::size_t i = part.begin(); i != part.end(); ++i) fn(i * grain, std::min(n, (i + 1) * grain));
        });
      });
    });
  }

  /// From inside a loop the fraction is only noted, for the next event to tell: a message sent there would spawn tasks
  /// that carry the loop's isolation, and the loop's wait would run them.
  void ReportProgress(double fraction) override {
    if (!observed_) return;
    const auto now = static_cast<float>(std::clamp(fraction, 0.0, 1.0));
    if (now < slot_.fraction.load(std::memory_order_relaxed) + kProgressStep && now < 1) return;
    slot_.fraction.store(now, std::memory_order_relaxed);
    if (loops_.load(std::memory_order_relaxed) == 0) scheduler_.try_put({id_, Event::Kind::kProgress});
  }

 private:
  static constexpr float kProgressStep = 0.005f;
  bool observed_;
  TaskId id_;
  Slot& slot_;
  SchedulerNode& scheduler_;
  std::atomic<int> loops_{0};
};

/// Everything below "scheduler" is touched by the scheduler node alone, which runs one event at a time.
class FlowRun {
 public:
  FlowRun(Plan& plan, const ExecutionOptions& options)
      : plan_(plan),
        options_(options),
        budget_(options.memory_bytes),
        scheduler_(graph_, flow::serial,
                   [this](const Event& event, auto& ports) noexcept { Handle(event, std::get<0>(ports)); }),
        worker_(graph_, flow::unlimited, [this](TaskId id) { return Work(id); }) {
    budget_.Register(plan_);
    budget_.RefuseWhatNeverFits(plan_);
    flow::make_edge(flow::output_port<0>(scheduler_), worker_);
    flow::make_edge(worker_, scheduler_);
  }

  ExecutionReport Run() {
    scheduler_.try_put({});
    graph_.wait_for_all();
    for (std::uint32_t i = 0; i < records_.size(); ++i)
      if (ended_[i] == TaskState::kPending) End(TaskId(i), TaskState::kCancelled);
    if (observer_failure_) std::rethrow_exception(observer_failure_);
    report_.peak_live_bytes = budget_.peak_live_bytes();
    report_.outcomes.reserve(slots_.size());
    for (Slot& slot : slots_) report_.outcomes.push_back(std::move(slot.outcome));
    return std::move(report_);
  }

 private:
  using WorkerPort = std::tuple_element_t<0, SchedulerNode::output_ports_type>;

  struct Record {
    std::uint32_t needs_left = 0;
    std::vector<TaskId> dependents;
  };

  // Workers ----------------------------------------------------------------------------------------------------------

  Event Work(TaskId id) noexcept {
    Slot& slot = slots_[id.value];
    slot.span.task = id;
    slot.span.worker = oneapi::tbb::this_task_arena::current_thread_index();
    slot.span.start_s = slot.span.end_s = clock_.Now_s();
    if (StopRequested()) {
      slot.outcome.state = TaskState::kCancelled;
      return {id, Event::Kind::kFinished};
    }
    if (!options_.observers.empty()) scheduler_.try_put({id, Event::Kind::kStarted});
    FlowTaskRun run(options_, clock_, id, slot, scheduler_);
    TaskOutcome outcome = run.Execute(*slot.task);
    run.CompleteSpan(slot.span);
    slot.span.reused = outcome.reused;
    slot.grows = run.TakeGrows();
    slot.outcome = std::move(outcome);
    return {id, Event::Kind::kFinished};
  }

  bool StopRequested() const { return options_.stop != nullptr && options_.stop->StopRequested(); }

  // Scheduler --------------------------------------------------------------------------------------------------------

  void Handle(const Event& event, WorkerPort& workers) noexcept {
    const Slot* slot = event.kind == Event::Kind::kBegin ? nullptr : &slots_[event.id.value];
    switch (event.kind) {
      case Event::Kind::kBegin:
        AddTasks();
        break;
      case Event::Kind::kStarted:
        Tell([&](Observer& observer) { observer.OnTaskStarted(event.id, *slot->task, slot->span.worker); });
        return;
      case Event::Kind::kProgress:
        Tell([&](Observer& observer) {
          observer.OnTaskProgress(event.id, *slot->task, slot->fraction.load(std::memory_order_relaxed));
        });
        return;
      case Event::Kind::kFinished:
        --in_flight_;
        FinishRun(event.id);
        break;
    }
    Admit(workers);
  }

  /// An observer that throws ends the run in order; Run rethrows what it threw first.
  template <class Fn>
  void Tell(Fn&& fn) noexcept {
    try {
      for (Observer* observer : options_.observers) fn(*observer);
    } catch (...) {
      if (!observer_failure_) observer_failure_ = std::current_exception();
    }
  }

  /// Takes in the tasks of the plan not seen yet.
  void AddTasks(TaskState initial = TaskState::kPending) {
    const std::size_t old_size = records_.size();
    budget_.Register(plan_);
    records_.resize(plan_.size());
    ended_.resize(plan_.size(), TaskState::kPending);
    slots_.grow_to_at_least(plan_.size());
    for (std::size_t i = old_size; i < plan_.size(); ++i) {
      const TaskId id(static_cast<std::uint32_t>(i));
      slots_[i].task = &plan_.task(id);
      Tell([&](Observer& observer) { observer.OnTaskAdded(id, *slots_[i].task); });
    }
    for (std::size_t i = old_size; i < plan_.size(); ++i) {
      const TaskId id(static_cast<std::uint32_t>(i));
      const TaskState state = initial == TaskState::kPending ? LinkToNeeds(id) : initial;
      if (state != TaskState::kPending) {
        End(id, state);
      } else if (records_[i].needs_left == 0) {
        MakeReady(id);
      }
    }
  }

  /// kSkipped or kCancelled when a need has already ended so.
  TaskState LinkToNeeds(TaskId id) {
    TaskState state = TaskState::kPending;
    for (const TaskId need : slots_[id.value].task->needs) {
      const TaskState needed = ended_[need.value];
      if (needed == TaskState::kDone) continue;
      if (needed == TaskState::kPending) {
        ++records_[id.value].needs_left;
        records_[need.value].dependents.push_back(id);
      } else if (state != TaskState::kSkipped) {
        state = needed == TaskState::kCancelled ? TaskState::kCancelled : TaskState::kSkipped;
      }
    }
    return state;
  }

  void MakeReady(TaskId id) {
    if (!budget_.IsTooLarge(id)) return ready_.Push(id);
    FailForMemory(id, 0);
  }

  void FailForMemory(TaskId id, std::uint64_t kept_bytes) {
    const Task& task = *slots_[id.value].task;
    slots_[id.value].outcome.error =
        Error(ErrorCode::kOutOfMemoryBudget, "", budget_.DescribeRefusal(task, kept_bytes), task.memory_hint).what();
    End(id, TaskState::kFailed);
  }

  void FinishRun(TaskId id) {
    Slot& slot = slots_[id.value];
    if (slot.outcome.state == TaskState::kDone && !slot.grows.empty()) {
      GrowPlan(plan_, id, slot.grows, slot.outcome);
      slot.grows.clear();
      AddTasks(slot.outcome.state == TaskState::kDone ? TaskState::kPending : TaskState::kSkipped);
    }
    End(id, slot.outcome.state);
  }

  /// The task's final state; what could only follow its success ends with it. Iterative: chains are as long as plans.
  void End(TaskId first, TaskState first_state) {
    std::vector<std::pair<TaskId, TaskState>> ends{{first, first_state}};
    while (!ends.empty()) {
      const auto [id, state] = ends.back();
      ends.pop_back();
      if (ended_[id.value] != TaskState::kPending) continue;
      ended_[id.value] = state;
      Slot& slot = slots_[id.value];
      slot.outcome.state = state;
      slot.span.task = id;
      budget_.Finish(plan_, id, state == TaskState::kDone);
      CountOutcome(slot.outcome, report_);
      Tell([&](Observer& observer) { observer.OnTaskFinished(id, *slot.task, slot.outcome, slot.span); });
      const TaskState next = state == TaskState::kCancelled ? TaskState::kCancelled : TaskState::kSkipped;
      for (const TaskId dependent : std::exchange(records_[id.value].dependents, {})) {
        if (state != TaskState::kDone) {
          ends.emplace_back(dependent, next);
        } else if (--records_[dependent.value].needs_left == 0 && ended_[dependent.value] == TaskState::kPending) {
          MakeReady(dependent);
        }
      }
    }
  }

  void Admit(WorkerPort& workers) {
    while (true) {
      ready_.Begin();
      std::optional<TaskId> lowest_refused;
      while (in_flight_ < options_.threads) {
        if (StopRequested() || observer_failure_) return;
        const auto id = ready_.Next();
        if (!id) break;
        if (budget_.TryAdmit(*id)) {
          ++in_flight_;
          workers.try_put(*id);
        } else {
          if (!lowest_refused) lowest_refused = id;
          ready_.Refuse(*id);
        }
      }
      if (in_flight_ > 0 || !lowest_refused) return;
      // Nothing runs and the lowest task does not fit beside what is kept: possible only after the plan grew.
      ready_.Begin();
      ready_.Next();
      FailForMemory(*lowest_refused, budget_.retained_bytes());
    }
  }

  Plan& plan_;
  const ExecutionOptions& options_;
  RunClock clock_;
  oneapi::tbb::concurrent_vector<Slot> slots_;

  MemoryBudget budget_;
  ReadyQueue ready_;
  std::vector<Record> records_;
  std::vector<TaskState> ended_;  ///< final state by task id, else kPending
  int in_flight_ = 0;
  ExecutionReport report_;
  std::exception_ptr observer_failure_;

  flow::graph graph_;
  SchedulerNode scheduler_;
  WorkerNode worker_;
};

class FlowExecutor : public Executor {
 public:
  ExecutionReport Run(Plan& plan, const ExecutionOptions& options) override {
    RILIEVO_CHECK(options.threads >= 1);
    const auto threads = static_cast<std::size_t>(options.threads);
    using Control = oneapi::tbb::global_control;
    const Control more_threads_than_cores(Control::max_allowed_parallelism,
                                          std::max(threads, Control::active_value(Control::max_allowed_parallelism)));
    oneapi::tbb::task_arena arena(options.threads);
    return arena.execute([&] { return FlowRun(plan, options).Run(); });
  }
};

}  // namespace

std::unique_ptr<Executor> MakeFlowExecutor() { return std::make_unique<FlowExecutor>(); }

}  // namespace rilievo::engine
