// Costs of tasks, and the summary of a run from them.
#include "scheduling/orient_costs.h"

#include <algorithm>

#include "base/units.h"
#include "scheduling/guided_plan.h"
#include "scheduling/workspace.h"
#include "stages/tracks/tracks.h"

namespace rilievo::scheduling {
namespace {

/// Usual on photographs of stone and plaster at the default contrast: 3300 features a megapixel, below the cap by a
/// third; one in seven matches in a pair that overlaps, and an image overlaps at most some thirty others.
constexpr double kUsualFeaturesPerPixel = 5e-3;
constexpr std::uint64_t kUsualFeaturesPerMatch = 7;
constexpr std::uint64_t kUsualPairsPerImage = 15;
constexpr std::uint64_t kDiskReserveBytes = 16 * kMebibyte;

std::uint64_t Cap(const OrientRun& run) { return static_cast<std::uint64_t>(run.options.features.max_features); }

double UsualTileWork(const OrientRun& run, const PairTile& tile) {
  double work_s = 0;
  for (const ImagePair& pair : tile.pairs) work_s += UsualPairWork(run, pair);
  return work_s;
}

/// The features of an image and what the matcher reads of them.
std::uint64_t LoadedImageBytes(const OrientRun& run) {
  return Cap(run) * kFeatureBytes + matching::PreparedBytes(static_cast<std::size_t>(Cap(run)), run.options.matching);
}

/// `images` loaded images and `pairs` of them. The features of every image, payload and parsed for the one being read;
/// matching and verification of one pair; the inliers of all pairs and their payload.
std::uint64_t PairTaskBytes(const OrientRun& run, std::size_t images, std::size_t pairs) {
  const auto cap = static_cast<std::size_t>(Cap(run));
  const TaskCost match = matching::Estimate(cap, cap, run.options.matching), verify = verification::Estimate(cap);
  const std::uint64_t result_bytes = pairs * (cap * sizeof(Match) + sizeof(TwoViewGeometry)) * 2;
  const std::uint64_t loading_bytes = images > 0 ? images * LoadedImageBytes(run) + 2 * cap * kFeatureBytes : 0;
  return loading_bytes + match.peak_bytes + verify.peak_bytes + result_bytes;
}

class SummaryBuilder {
 public:
  SummaryBuilder(const OrientRun& run, std::uint64_t budget_bytes, int threads)
      : run_(run), budget_bytes_(budget_bytes), threads_(threads), lanes_(threads) {}

  PlanSummary Build() {
    s_.images = s_.feature_tasks = run_.block.images.size();
    s_.pairs_at_most = s_.images * (s_.images - std::min<std::size_t>(s_.images, 1)) / 2;
    OrientKeys keys = run_.keys;
    if (!keys.tiles_complete) FindGuidedTiles(run_.block, run_.options, run_.store, keys);
    s_.pair_tasks = keys.tiles.size();
    s_.pairs_known = keys.tiles_complete;
    s_.orientation_done = run_.store.Exists(run_.keys.orientation);
    for (const Image& image : run_.block.images) AddImage(image);
    for (std::size_t t = 0; t < keys.tiles.size(); ++t) AddTile(keys.tiles[t], keys.pairs[t], t);
    if (!s_.pairs_known && !s_.orientation_done) AddUnknownPairs();
    if (!s_.orientation_done && run_.goal == Goal::kOrientation) AddOrientation();
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

  void AddTile(const PairTile& tile, const engine::ArtifactKey& key, std::size_t t) {
    s_.pairs += tile.pairs.size();
    if (run_.store.Exists(key)) {
      ++s_.pair_tasks_done;
      return;
    }
    if (s_.orientation_done) return;
    // Its columns are resident beside it; a tile alone in its column would hold the same images itself.
    const std::uint64_t resident_bytes = ResidentBlockBytes(run_, std::min(tile.images.size(), TileEdge(s_.images)));
    Consider(resident_bytes + PairTaskCost(run_, tile, true).peak_bytes, "pairs " + std::to_string(t),
             "lower --max-features");
    s_.disk_bytes += tile.pairs.size() * 300;
    pairs_s_ += UsualTileWork(run_, tile);
  }

  /// A guided block: the map, and as many pairs as usually overlap.
  void AddUnknownPairs() {
    const std::size_t edge = TileEdge(s_.images);
    Consider(PairTaskBytes(run_, 2 * edge, edge * edge), "pairs (a whole tile)", "lower --max-features");
    Consider(SketchTaskCost(run_).peak_bytes, "sketch", "lower --max-features");
    for (const PairTile& tile : VisibilityTiles(s_.images)) {
      const TaskCost cost = VisibilityTaskCost(run_, tile);
      Consider(cost.peak_bytes, "visibility map", "lower --guided-features");
      pairs_s_ += cost.work;
    }
    const std::uint64_t sketch = static_cast<std::uint64_t>(run_.options.pairs.guided_features) * kFeatureBytes;
    s_.disk_bytes += s_.images * sketch + 8 * s_.pairs_at_most;
    const std::size_t usual = UsualPairs(run_);
    if (usual <= s_.pairs) return;
    pairs_s_ += static_cast<double>(usual - s_.pairs) * UsualPairWork(run_, {ImageId(0), ImageId(1)});
    s_.disk_bytes += (usual - s_.pairs) * 300;
  }

  void AddOrientation() {
    const std::uint64_t inliers = UsualInliers(run_, s_.pairs_known ? s_.pairs : s_.pairs_at_most, features_);
    if (s_.pair_tasks_done < s_.pair_tasks || !s_.pairs_known) s_.disk_bytes += inliers * sizeof(Match);
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

std::uint64_t UsualFeatures(const OrientRun& run, const Image& image) {
  const double pixels = static_cast<double>(image.width_px) * image.height_px;
  return std::min(Cap(run), static_cast<std::uint64_t>(pixels * kUsualFeaturesPerPixel)) * 2 / 3;
}

/// Seconds of a pair at the usual numbers of features: matching is quadratic in them.
double UsualPairWork(const OrientRun& run, const ImagePair& pair) {
  const std::uint64_t a = UsualFeatures(run, run.block.image(pair.first));
  const std::uint64_t b = UsualFeatures(run, run.block.image(pair.second));
  return matching::Estimate(a, b, run.options.matching).work +
         verification::Estimate(std::min(a, b) / kUsualFeaturesPerMatch).work;
}

std::size_t UsualPairs(const OrientRun& run) {
  const std::size_t images = run.block.images.size();
  return std::min<std::size_t>(images * (images - std::min<std::size_t>(images, 1)) / 2, kUsualPairsPerImage * images);
}

std::uint64_t UsualInliers(const OrientRun& run, std::uint64_t pairs, std::uint64_t features) {
  const std::uint64_t images = std::max<std::uint64_t>(1, run.block.images.size());
  return std::min(pairs, kUsualPairsPerImage * images) * features / images / kUsualFeaturesPerMatch;
}

features::Tiling FeatureTiling(const OrientRun& run, const Image& image) {
  if (run.strip_width_px > 0) return {run.strip_width_px, 2};
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

TaskCost PairTaskCost(const OrientRun& run, const PairTile& tile, bool resident) {
  const auto in_column =
      static_cast<std::size_t>(std::count_if(tile.images.begin(), tile.images.end(), [&](ImageId id) {
        return id.value / TileEdge(run.block.images.size()) == tile.column;
      }));
  return {PairTaskBytes(run, tile.images.size() - (resident ? in_column : 0), tile.pairs.size()),
          UsualTileWork(run, tile)};
}

std::uint64_t ResidentBlockBytes(const OrientRun& run, std::size_t images) { return images * LoadedImageBytes(run); }

TaskCost BlockTaskCost(const OrientRun& run, std::size_t images) {
  return {ResidentBlockBytes(run, images) + 2 * Cap(run) * kFeatureBytes, 0.001 * static_cast<double>(images)};
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

bool IsDone(const PlanSummary& s, Goal goal) {
  const bool pairs_done = s.pairs_known && s.pair_tasks_done == s.pair_tasks && s.feature_tasks_done == s.feature_tasks;
  return s.orientation_done || (goal == Goal::kPairs && pairs_done);
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
