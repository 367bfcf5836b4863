// What is still to come of an orientation run: from its options, and from what its tasks have found so far.
#pragma once

#include <cstdint>

#include "engine/executor.h"
#include "engine/time_model.h"
#include "scheduling/orient_run.h"

namespace rilievo::scheduling {

/// Watches the run, and tells Progress of the work that no task of the plan declares yet. Declared costs go by the
/// usual number of features; as images are done, the matching of all pairs and the orientation are corrected by what
/// they have. Called by the executor's scheduler alone, like all observers.
class OrientForecast : public engine::Observer {
 public:
  OrientForecast(const OrientRun& run, int threads) : run_(run), threads_(threads) {}

  void OnTaskAdded(TaskId id, const engine::Task& task) override;
  void OnTaskFinished(TaskId id, const engine::Task& task, const engine::TaskOutcome& outcome,
                      const engine::TaskSpan& span) override;

  engine::RunForecast Forecast() const;

 private:
  double FeatureRatio() const;
  double OrientationWork() const;
  double UnknownPairWork() const;

  const OrientRun& run_;
  int threads_;
  bool has_orientation_ = false, map_complete_ = false;
  std::uint64_t pairs_in_plan_ = 0, pairs_done_ = 0, inliers_ = 0;
  double features_found_ = 0, features_usual_ = 0;  ///< of the images that are done
};

}  // namespace rilievo::scheduling
