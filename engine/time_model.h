// How far a run is and how long it will take: from declared work, and from what the run's own tasks have taken.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "base/ids.h"

namespace rilievo::engine {

/// Work of a stage that is to come and that no task of the plan declares yet: pairs not known, the orientation. All in
/// the unit of TaskCost::work, about a second of one core.
struct StageForecast {
  std::string stage;
  double more_work = 0;     ///< beside the tasks in the plan
  double scale = 1;         ///< of the declared work of all of its tasks, by what is known by now
  bool comes_last = false;  ///< begins when all others have ended, on one thread
};

struct RunForecast {
  int threads = 0;  ///< 0 = as many as have been busy so far
  std::vector<StageForecast> stages;
};

/// Pure bookkeeping; times in seconds from any origin. A stage takes its declared work times a factor, its own as far
/// as its tasks have been measured, else that of the stages that have been: the machine is as much slower or faster for
/// all as for these.
///
/// A machine that others use, too, gives the run a share of its processors, and to one thread about as much as to
/// several: the last stage, which has one, is not slowed down as the workers are who share that share.
class TimeModel {
 public:
  void Add(const std::string& stage, double work);
  void Start(TaskId id, const std::string& stage, double work, double now_s);
  /// A task that says how far it is tells its speed before it ends.
  void SetFraction(TaskId id, double fraction);
  /// `computed`: it ran and did its work; else (reused, failed, skipped) nothing is learnt from it. `helped_s`: what
  /// other workers did in its loops; `cpu_s`: processor time of all, 0 = not known.
  void Finish(TaskId id, const std::string& stage, double work, bool computed, double now_s, double helped_s = 0,
              double cpu_s = 0);

  struct Estimate {
    double fraction = 0;  ///< of the run's time
    double left_s = -1;   ///< -1 = not known
  };
  Estimate At(double now_s, const RunForecast& forecast) const;

 private:
  struct Stage {
    double waiting_work = 0;   ///< declared, not begun
    std::size_t waiting = 0;   ///< tasks
    double measured_work = 0;  ///< computed, and its worker seconds
    double measured_s = 0;
    std::size_t measured = 0;  ///< tasks
  };
  struct Running {
    std::string stage;
    double work = 0, start_s = 0, fraction = 0;
  };
  static void Unwait(Stage& stage, double work);
  /// Until `stage` alone would have ended, its waiting tasks one after another on whichever worker becomes free.
  static double WavesLeft_s(const Stage& stage, double factor, std::vector<double> busy_until_s, double threads);
  static double RunningLeft_s(const Running& task, double factor, double now_s);
  std::map<std::string, Stage> Measured(double now_s, const RunForecast& forecast) const;

  std::map<std::string, Stage> stages_;
  std::map<TaskId, Running> running_;
  double first_start_s_ = -1;
  double worker_s_ = 0, cpu_s_ = 0;  ///< of computed tasks whose processor time is known
};

}  // namespace rilievo::engine
