// Costs of tasks, and the summary of a run from them.
#include "scheduling/orient_costs.h"

#include <algorithm>

#include "base/units.h"
#include "scheduling/workspace.h"
#include "stages/tracks/tracks.h"

namespace rilievo::scheduling {
namespace {

constexpr std::uint64_t kFeatureBytes = sizeof(Keypoint) + sizeof(Descriptor) + sizeof(Rgb);
/// Usual on photographs of stone and plaster at the default contrast: 3300 features a megapixel, below the cap by a
/// third; one in seven matches in a pair that overlaps, and an image overlaps at most some thirty others.
constexpr double kUsualFeaturesPerPixel = 5e-3;
constexpr std::uint64_t kUsualFeaturesPerMatch = 7;
constexpr std::uint64_t kUsualPairsPerImage = 15;
constexpr std::uint64_t kDiskReserveBytes = 16 * kMebibyte;

std::uint64_t Cap(const OrientRun& run) { return static_cast<std::uint64_t>(run.options.features.max_features); }

std::uint64_t UsualFeatures(const OrientRun& run, const Image& image) {
  const double pixels = static_cast<double>(image.width_px) * image.height_px;
  return std::min(Cap(run), static_cast<std::uint64_t>(pixels * kUsualFeaturesPerPixel)) * 2 / 3;
}

/// Seconds of a tile at the usual numbers of features: matching is quadratic in them.
double UsualPairWork(const OrientRun& run, const PairTile& tile) {
  double work_s = 0;
  for (const ImagePair& pair : tile.pairs) {
    const std::uint64_t a = UsualFeatures(run, run.block.image(pair.first));
    const std::uint64_t b = UsualFeatures(run, run.block.image(pair.second));
    work_s += matching::Estimate(a, b, run.options.matching).work +
              verification::Estimate(std::min(a, b) / kUsualFeaturesPerMatch).work;
  }
  return work_s;
}

class SummaryBuilder {
 public:
  SummaryBuilder(const OrientRun& run, std::uint64_t budget_bytes, int threads)
      : run_(run), budget_bytes_(budget_bytes), threads_(threads), lanes_(threads) {}

  PlanSummary Build() {
    s_.images = s_.feature_tasks = run_.block.images.size();
    s_.pair_tasks = run_.keys.tiles.size();
    s_.orientation_done = run_.store.Exists(run_.keys.orientation);
    for (const Image& image : run_.block.images) AddImage(image);
    for (std::size_t t = 0; t < run_.keys.tiles.size(); ++t) AddTile(t);
    if (!s_.orientation_done) AddOrientation();
    s_.work_s = features_s_ + pairs_s_ + orientation_s_;
    s_.time_s = std::max(features_s_ / lanes_, (features_s_ + pairs_s_) / threads_) + orientation_s_;
    return s_;
  }

 private:
  void Consider(std::uint64_t peak_bytes, const std::string& task, const std::string& otherwise) {
    if (peak_bytes <= s_.peak_bytes) return;
    s_.peak_bytes = peak_bytes;
    s_.peak_task = task;
    s_.peak_hint = MemoryHint(run_, peak_bytes, otherwise);
  }

  void AddImage(const Image& image) {
    features_ += UsualFeatures(run_, image);
    if (run_.store.Exists(run_.keys.features[image.id.value])) {
      ++s_.feature_tasks_done;
      return;
    }
    if (s_.orientation_done) return;
    const TaskCost cost = FeatureTaskCost(run_, image);
    Consider(cost.peak_bytes, "features " + image.name, "smaller images");
    s_.disk_bytes += UsualFeatures(run_, image) * kFeatureBytes + 200;
    features_s_ += cost.work;
    const std::uint64_t at_once =
        std::max<std::uint64_t>(1, budget_bytes_ / std::max<std::uint64_t>(1, cost.peak_bytes));
    lanes_ = std::min(lanes_, static_cast<int>(std::min<std::uint64_t>(at_once, 1024)));
  }

  void AddTile(std::size_t t) {
    const PairTile& tile = run_.keys.tiles[t];
    s_.pairs += tile.pairs.size();
    if (run_.store.Exists(run_.keys.pairs[t])) {
      ++s_.pair_tasks_done;
      return;
    }
    if (s_.orientation_done) return;
    Consider(PairTaskCost(run_, tile).peak_bytes, "pairs " + std::to_string(t), "lower --max-features");
    s_.disk_bytes += tile.pairs.size() * 300;
    pairs_s_ += UsualPairWork(run_, tile);
  }

  void AddOrientation() {
    const std::uint64_t overlapping = std::min(s_.pairs, kUsualPairsPerImage * s_.images);
    const std::uint64_t inliers =
        overlapping * features_ / std::max<std::uint64_t>(1, s_.images) / kUsualFeaturesPerMatch;
    if (s_.pair_tasks_done < s_.pair_tasks) s_.disk_bytes += inliers * sizeof(Match);
    const TaskCost cost = OrientationTaskCost(run_, features_, inliers);
    Consider(cost.peak_bytes, "orientation (estimated)", "lower --max-features");
    orientation_s_ = cost.work;
    s_.disk_bytes += features_ * 60;
  }

  const OrientRun& run_;
  std::uint64_t budget_bytes_;
  int threads_, lanes_;
  PlanSummary s_;
  std::uint64_t features_ = 0;
  double features_s_ = 0, pairs_s_ = 0, orientation_s_ = 0;
};

}  // namespace

features::Tiling FeatureTiling(const OrientRun& run, const Image& image) {
  const std::uint64_t beside = 2 * Cap(run) * kFeatureBytes;
  return features::ChooseTiling(image.width_px, image.height_px, image.bits_per_sample, run.options.features,
                                run.budget_bytes - std::min(run.budget_bytes, beside));
}

TaskCost FeatureTaskCost(const OrientRun& run, const Image& image) {
  TaskCost cost = features::Estimate(image.width_px, image.height_px, image.bits_per_sample, run.options.features,
                                     FeatureTiling(run, image));
  const auto pixels = static_cast<std::uint64_t>(image.width_px) * static_cast<std::uint64_t>(image.height_px);
  cost.peak_bytes = std::max(cost.peak_bytes, run.pixels.LoadPeakBytes(image, true)) + 2 * Cap(run) * kFeatureBytes;
  if (image.mask) cost.peak_bytes = std::max(cost.peak_bytes + pixels, image.mask->load_peak_bytes);
  return cost;
}

TaskCost PairTaskCost(const OrientRun& run, const PairTile& tile) {
  const auto cap = static_cast<std::size_t>(Cap(run));
  const TaskCost match = matching::Estimate(cap, cap, run.options.matching), verify = verification::Estimate(cap);
  // The features of every image, payload and parsed for the one being read; the matches of all pairs and their payload.
  const std::uint64_t result_bytes = tile.pairs.size() * (cap * sizeof(Match) + sizeof(TwoViewGeometry)) * 2;
  return {cap * kFeatureBytes * (tile.images.size() + 2) + match.peak_bytes + verify.peak_bytes + result_bytes,
          UsualPairWork(run, tile)};
}

TaskCost OrientationTaskCost(const OrientRun& run, std::uint64_t features, std::uint64_t inliers) {
  const TaskCost mapping = mapping::Estimate(run.block.images.size(), features, inliers);
  const TaskCost tracks = tracks::Estimate(inliers, features);
  const std::uint64_t inputs =
      features * (sizeof(Keypoint) + sizeof(Rgb)) + 2 * inliers * sizeof(Match) + Cap(run) * 2 * sizeof(Descriptor);
  return {inputs + std::max(tracks.peak_bytes, mapping.peak_bytes), tracks.work + mapping.work};
}

std::string MemoryHint(const OrientRun& run, std::uint64_t peak_bytes, const std::string& otherwise) {
  return "use --memory " + std::to_string((peak_bytes + run.overhead_bytes) / kMebibyte + 1) + "MiB or more, or " +
         otherwise;
}

PlanSummary Summarize(const OrientRun& run, std::uint64_t budget_bytes, int threads) {
  return SummaryBuilder(run, budget_bytes, threads).Build();
}

void RefuseWhatCannotFit(const PlanSummary& summary, std::uint64_t budget_bytes, std::uint64_t overhead_bytes,
                         const std::filesystem::path& workspace) {
  if (summary.peak_bytes > budget_bytes)
    throw Error(ErrorCode::kOutOfMemoryBudget, "--memory",
                "'" + summary.peak_task + "' needs " + FormatBytes(summary.peak_bytes) + " beside " +
                    FormatBytes(overhead_bytes) + " for the program itself, and " +
                    FormatBytes(budget_bytes + overhead_bytes) + " are allowed",
                summary.peak_hint);
  const std::uint64_t free_bytes = FreeDiskBytes(workspace);
  if (summary.disk_bytes > 0 && summary.disk_bytes + kDiskReserveBytes > free_bytes)
    throw Error(ErrorCode::kDiskFull, workspace.string(),
                "the run needs about " + FormatBytes(summary.disk_bytes + kDiskReserveBytes) + " on this disk and " +
                    FormatBytes(free_bytes) + " are free",
                "free some space, or give a --workspace on another disk");
}

}  // namespace rilievo::scheduling
