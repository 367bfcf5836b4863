// Factors of stages, and the time that is left on so many threads.
#include "engine/time_model.h"

#include <algorithm>
#include <functional>
#include <queue>

namespace rilievo::engine {
namespace {

/// The factor of all that has been measured weighs as much as this part of a task of the stage itself.
constexpr double kTasksOfPrior = 0.25;
/// A task that says how far it is, but hardly begun, tells nothing yet.
constexpr double kLeastFraction = 0.05;
/// A task that takes longer than it should has this share of its time so far still to go.
constexpr double kOverdue = 0.1;
constexpr double kAboutToEnd = 0.9;

const StageForecast* Find(const RunForecast& forecast, const std::string& stage) {
  for (const StageForecast& s : forecast.stages)
    if (s.stage == stage) return &s;
  return nullptr;
}

double ScaleOf(const RunForecast& forecast, const std::string& stage) {
  const StageForecast* const told = Find(forecast, stage);
  return told != nullptr ? told->scale : 1;
}

bool ComesLast(const RunForecast& forecast, const std::string& stage) {
  const StageForecast* const told = Find(forecast, stage);
  return told != nullptr && told->comes_last;
}

}  // namespace

void TimeModel::Add(const std::string& stage, double work) {
  Stage& s = stages_[stage];
  s.waiting_work += work;
  ++s.waiting;
}

void TimeModel::Start(TaskId id, const std::string& stage, double work, double now_s) {
  if (first_start_s_ < 0) first_start_s_ = now_s;
  Unwait(stages_[stage], work);
  running_[id] = {stage, work, now_s, 0};
}

void TimeModel::SetFraction(TaskId id, double fraction) {
  if (const auto found = running_.find(id); found != running_.end())
    found->second.fraction = std::clamp(fraction, 0.0, 1.0);
}

void TimeModel::Finish(TaskId id, const std::string& stage, double work, bool computed, double now_s, double helped_s,
                       double cpu_s) {
  const auto found = running_.find(id);
  if (found == running_.end()) {  // it never began
    Unwait(stages_[stage], work);
    return;
  }
  if (computed) {
    Stage& s = stages_[stage];
    s.measured_work += work;
    s.measured_s += now_s - found->second.start_s + helped_s;
    ++s.measured;
    if (cpu_s > 0) {
      worker_s_ += now_s - found->second.start_s + helped_s;
      cpu_s_ += cpu_s;
    }
  }
  running_.erase(found);
}

void TimeModel::Unwait(Stage& stage, double work) {
  stage.waiting_work -= work;
  stage.waiting -= stage.waiting > 0 ? 1 : 0;
}

double TimeModel::WavesLeft_s(const Stage& stage, double factor, std::vector<double> busy_until_s, double threads) {
  constexpr std::size_t kManyWaves = 32;  // then the last one matters little
  const auto workers = static_cast<std::size_t>(threads + 0.5);
  if (stage.waiting == 0 || workers < 2 || stage.waiting > kManyWaves * workers) return 0;
  const double each_s = stage.waiting_work * factor / static_cast<double>(stage.waiting);
  if (busy_until_s.size() < workers) busy_until_s.resize(workers, 0);
  std::priority_queue<double, std::vector<double>, std::greater<>> free_at_s(busy_until_s.begin(), busy_until_s.end());
  double end_s = 0;
  for (std::size_t i = 0; i < stage.waiting; ++i) {
    const double start_s = free_at_s.top();
    free_at_s.pop();
    free_at_s.push(start_s + each_s);
    end_s = std::max(end_s, start_s + each_s);
  }
  return end_s;
}

/// The stages with their work as the forecast scales it, and with what running tasks tell.
std::map<std::string, TimeModel::Stage> TimeModel::Measured(double now_s, const RunForecast& forecast) const {
  std::map<std::string, Stage> stages = stages_;
  for (const auto& [id, task] : running_) {
    if (task.fraction < kLeastFraction) continue;
    Stage& stage = stages[task.stage];
    stage.measured_work += task.fraction * task.work;
    stage.measured_s += now_s - task.start_s;
    ++stage.measured;
  }
  // The first to end is the shortest of those that began together: the others, about to end, count as well.
  for (const auto& [id, task] : running_) {
    const Stage& ended = stages_.at(task.stage);
    const double so_far_s = now_s - task.start_s;
    if (task.fraction >= kLeastFraction || ended.measured == 0 ||
        so_far_s * ended.measured_work < kAboutToEnd * ended.measured_s * task.work)
      continue;
    Stage& stage = stages[task.stage];
    stage.measured_work += task.work;
    stage.measured_s += (1 + kOverdue) * so_far_s;
    ++stage.measured;
  }
  for (auto& [name, stage] : stages) {
    const double scale = ScaleOf(forecast, name);
    stage.waiting_work = scale * std::max(0.0, stage.waiting_work);
    stage.measured_work *= scale;
  }
  return stages;
}

double TimeModel::RunningLeft_s(const Running& task, double factor, double now_s) {
  const double so_far_s = now_s - task.start_s, whole_s = task.work * factor;
  if (task.fraction >= kLeastFraction) return so_far_s * (1 - task.fraction) / task.fraction;
  return std::max(whole_s - so_far_s, std::min(whole_s, kOverdue * so_far_s));
}

TimeModel::Estimate TimeModel::At(double now_s, const RunForecast& forecast) const {
  const std::map<std::string, Stage> stages = Measured(now_s, forecast);
  double all_work = 0, all_s = 0;
  for (const auto& [name, stage] : stages) {
    all_work += stage.measured_work;
    all_s += stage.measured_s;
  }
  if (all_work <= 0 || now_s <= first_start_s_) return {};
  const double common = all_s / all_work, elapsed_s = now_s - first_start_s_;
  const auto factor = [&](const std::string& name) {
    const auto found = stages.find(name);
    if (found == stages.end() || found->second.measured == 0) return common;
    const Stage& stage = found->second;
    const double prior_work = kTasksOfPrior * stage.measured_work / static_cast<double>(stage.measured);
    return (stage.measured_s + prior_work * common) / (stage.measured_work + prior_work);
  };

  double busy_s = 0;
  for (const auto& [name, stage] : stages_) busy_s += stage.measured_s;
  for (const auto& [id, task] : running_) busy_s += now_s - task.start_s;
  const double threads = forecast.threads > 0 ? forecast.threads : std::max(1.0, busy_s / elapsed_s);
  // Seconds of one thread that has the run's share of the machine to itself, for a second of one worker among others.
  const double share = worker_s_ > 0 ? std::clamp(cpu_s_ / worker_s_, 0.01, 1.0) : 1;
  const double alone = share / std::min(1.0, threads * share);

  double shared_s = 0, last_s = 0;  // worker seconds; wall seconds
  const auto add = [&](const std::string& name, double worker_s) {
    ComesLast(forecast, name) ? last_s += alone* worker_s : shared_s += worker_s;
  };
  for (const auto& [name, stage] : stages) add(name, stage.waiting_work * factor(name));
  for (const StageForecast& told : forecast.stages) add(told.stage, told.more_work * factor(told.stage));
  std::vector<double> running_left_s;
  for (const auto& [id, task] : running_) {
    const double a_unit_s = ScaleOf(forecast, task.stage) * factor(task.stage);
    if (ComesLast(forecast, task.stage)) {
      last_s += RunningLeft_s(task, alone * a_unit_s, now_s);
      continue;
    }
    running_left_s.push_back(RunningLeft_s(task, a_unit_s, now_s));
    shared_s += running_left_s.back();
  }
  double shared_left_s = shared_s / threads;
  for (const double left : running_left_s) shared_left_s = std::max(shared_left_s, left);
  for (const auto& [name, stage] : stages)
    if (!ComesLast(forecast, name))
      shared_left_s = std::max(shared_left_s, WavesLeft_s(stage, factor(name), running_left_s, threads));
  Estimate estimate;
  estimate.left_s = shared_left_s + last_s;
  estimate.fraction = elapsed_s / (elapsed_s + estimate.left_s);
  return estimate;
}

}  // namespace rilievo::engine
