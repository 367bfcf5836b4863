// What the tasks of an orientation cost: memory, disk, time; and whether a run can fit.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "base/task_cost.h"
#include "scheduling/orient_run.h"

namespace rilievo::scheduling {

/// Of one feature in memory and in its artifact.
inline constexpr std::uint64_t kFeatureBytes = sizeof(Keypoint) + sizeof(Descriptor) + sizeof(Rgb);

/// How an image is cut while its features are detected, within what a task may hold.
features::Tiling FeatureTiling(const OrientRun& run, const Image& image);
/// Upper bounds from the image sizes and the caps of the options.
TaskCost FeatureTaskCost(const OrientRun& run, const Image& image);
/// `resident`: the features of the tile's columns are in the resident block, which is charged apart.
TaskCost PairTaskCost(const OrientRun& run, const PairTile& tile, bool resident);
/// What a resident block of so many images keeps, and what its task needs while it loads it.
std::uint64_t ResidentBlockBytes(const OrientRun& run, std::size_t images);
TaskCost BlockTaskCost(const OrientRun& run, std::size_t images);
/// From the numbers of features and of matches in verified pairs, all images together.
TaskCost OrientationTaskCost(const OrientRun& run, std::uint64_t features, std::uint64_t inliers);

/// What is usual, before it is known: features of an image; verified matches of so many pairs, when the images have so
/// many features in all; the work of so many pairs beyond those that are known.
std::uint64_t UsualFeatures(const OrientRun& run, const Image& image);
std::uint64_t UsualInliers(const OrientRun& run, std::uint64_t pairs, std::uint64_t features);
std::size_t UsualPairs(const OrientRun& run);  ///< of a guided block
double UsualPairWork(const OrientRun& run, const ImagePair& pair);

/// The --memory with which a task of this peak runs, as the hint of a refusal: "use --memory 3100MiB or more, or ...".
std::string MemoryHint(const OrientRun& run, std::uint64_t peak_bytes, const std::string& otherwise);

/// What a run would do, without running it. Costs are of what is still to be done.
struct PlanSummary {
  std::size_t images = 0, feature_tasks = 0, pair_tasks = 0;
  std::size_t pairs = 0;    ///< of a guided block: those known
  bool pairs_known = true;  ///< false: a guided block whose pairs are still to be found, `pairs_at_most` in all
  std::size_t pairs_at_most = 0;
  std::size_t feature_tasks_done = 0, pair_tasks_done = 0;
  bool orientation_done = false;
  std::uint64_t peak_bytes = 0;  ///< largest task; the orientation's from the usual number of features
  std::string peak_task, peak_hint;
  std::uint64_t disk_bytes =
      0;              ///< to be written: from the usual number of features and matches, not more than the caps
  double work_s = 0;  ///< CPU seconds
  double time_s = 0;  ///< wall time on `threads` within `budget_bytes`
};

/// Whether what the run was asked for is there.
bool IsDone(const PlanSummary& summary, Goal goal);

PlanSummary Summarize(const OrientRun& run, std::uint64_t budget_bytes, int threads);

/// Throws Error(kOutOfMemoryBudget) when a task of the run cannot fit `budget_bytes`, naming the memory that would do,
/// and Error(kDiskFull) when the disk of `workspace` has not the space.
void RefuseWhatCannotFit(const PlanSummary& summary, std::uint64_t budget_bytes, std::uint64_t overhead_bytes,
                         const std::filesystem::path& workspace);

}  // namespace rilievo::scheduling
