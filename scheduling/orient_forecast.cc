// Sums of what has been found, and what follows from them.
#include "scheduling/orient_forecast.h"

#include <algorithm>

#include "scheduling/orient_costs.h"

namespace rilievo::scheduling {
namespace {

/// The place of a task among `tasks`, which are in ascending order.
std::size_t PlaceOf(const std::vector<TaskId>& tasks, TaskId id) {
  const auto found = std::lower_bound(tasks.begin(), tasks.end(), id);
  return found == tasks.end() || *found != id ? tasks.size() : static_cast<std::size_t>(found - tasks.begin());
}

}  // namespace

void OrientForecast::OnTaskAdded(TaskId, const engine::Task& task) {
  has_orientation_ |= task.stage == "orientation";
  map_complete_ |= task.stage == "growth";
  if (task.stage == "pairs") pairs_in_plan_ += static_cast<std::uint64_t>(task.units.amount);
}

void OrientForecast::OnTaskFinished(TaskId id, const engine::Task& task, const engine::TaskOutcome& outcome,
                                    const engine::TaskSpan&) {
  if (outcome.state != engine::TaskState::kDone) return;
  if (task.stage == "features") {
    const std::size_t image = PlaceOf(run_.feature_tasks, id);
    if (image >= run_.images.size()) return;
    features_found_ += run_.images[image].features;
    features_usual_ += static_cast<double>(UsualFeatures(run_, run_.block.images[image]));
  } else if (task.stage == "pairs") {
    const std::size_t tile = PlaceOf(run_.tile_tasks, id);
    if (tile >= run_.tiles.size()) return;
    pairs_done_ += run_.tiles[tile]->pairs.size();
    for (const PairSummary& pair : run_.tiles[tile]->pairs) inliers_ += pair.inliers;
  }
}

double OrientForecast::FeatureRatio() const { return features_usual_ > 0 ? features_found_ / features_usual_ : 1; }

double OrientForecast::UnknownPairWork() const {
  if (run_.options.network != Network::kGuided || map_complete_ || run_.block.images.size() < 2) return 0;
  const double more = static_cast<double>(UsualPairs(run_)) - static_cast<double>(pairs_in_plan_);
  return std::max(0.0, more) * UsualPairWork(run_, {ImageId(0), ImageId(1)});
}

/// The pairs done tell of those to come, the more of them there are: the first ones are of images that follow one
/// another and overlap more than most.
double OrientForecast::OrientationWork() const {
  if (run_.goal != Goal::kOrientation || has_orientation_) return 0;
  double usual = 0;
  for (const Image& image : run_.block.images) usual += static_cast<double>(UsualFeatures(run_, image));
  const auto features = static_cast<std::uint64_t>(features_found_ + FeatureRatio() * (usual - features_usual_));
  const std::uint64_t pairs = map_complete_ || run_.options.network != Network::kGuided
                                  ? pairs_in_plan_
                                  : std::max<std::uint64_t>(pairs_in_plan_, UsualPairs(run_));
  if (pairs == 0) return 0;
  const double done = static_cast<double>(pairs_done_) / static_cast<double>(pairs);
  const auto usual_inliers = static_cast<double>(UsualInliers(run_, pairs, features));
  const double seen_inliers = done > 0 ? static_cast<double>(inliers_) / done : 0;
  const double inliers =
      static_cast<double>(inliers_) + (1 - done) * (done * seen_inliers + (1 - done) * usual_inliers);
  return OrientationTaskCost(run_, features, static_cast<std::uint64_t>(std::max(0.0, inliers))).work;
}

engine::RunForecast OrientForecast::Forecast() const {
  const double ratio_sq = FeatureRatio() * FeatureRatio();
  return {threads_,
          {{"pairs", ratio_sq * UnknownPairWork(), ratio_sq, false}, {"orientation", OrientationWork(), 1, true}}};
}

}  // namespace rilievo::scheduling
