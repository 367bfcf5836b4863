// Matches and verifies the pairs of a tile, and keeps the features of a block of images for a column of tiles.
#include "scheduling/pair_tasks.h"

#include <algorithm>
#include <atomic>
#include <optional>
#include <set>
#include <utility>

#include "base/hash.h"
#include "base/rng.h"
#include "block/io/serialize_block.h"
#include "scheduling/counted_io.h"
#include "scheduling/feature_tasks.h"
#include "scheduling/former_pairs.h"
#include "scheduling/orient_costs.h"

namespace rilievo::scheduling {
namespace {

using engine::TaskContext;

/// Seeds a pair by the features of its images, so that its result depends neither on the other images nor on bytes of
/// the files that are no pixels.
class PairContext : public RunContext {
 public:
  PairContext(RunContext& base, const ImageFeatures& first, const ImageFeatures& second) : base_(base) {
    const std::uint64_t a = Checksum(std::as_bytes(std::span(first.keypoints)));
    const std::uint64_t b = Checksum(std::as_bytes(std::span(second.keypoints)));
    seed_ = Mix64(base.Seed() ^ Mix64(a) ^ Mix64(Mix64(b)));
  }
  bool StopRequested() const override { return base_.StopRequested(); }
  std::uint64_t Seed() const override { return seed_; }
  void ParallelFor(std::size_t n, std::size_t grain, const std::function<void(std::size_t, std::size_t)>& fn) override {
    base_.ParallelFor(n, grain, fn);
  }
  void ReportProgress(double) override {}
  void RunKernel(const KernelName& kernel, double multiply_adds, const std::function<void()>& body) override {
    base_.RunKernel(kernel, multiply_adds, body);
  }

 private:
  RunContext& base_;
  std::uint64_t seed_ = 0;
};

PairSummary Summarise(const TwoViewGeometry& g) {
  return {g.pair,
          g.model,
          g.reason,
          g.matches,
          static_cast<std::uint32_t>(g.inliers.size()),
          g.median_angle_rad,
          g.homography_ratio};
}

/// The features of an image, packed for the matcher: once for all of its pairs in a tile or column.
struct LoadedImage {
  ImageFeatures features;
  matching::Prepared prepared;  ///< of the descriptors above; empty where those of each sign are matched apart
};

LoadedImage Load(const OrientRun& run, ImageId id, TaskContext& context) {
  LoadedImage image{LoadFeatures(run, id, context), {}};
  if (!features::ComparesEqualSignsOnly(run.options.features))
    image.prepared = matching::Prepare(image.features.descriptors, run.options.matching);
  return image;
}

TwoViewGeometry MatchAndVerify(const OrientRun& run, const ImagePair& pair, const LoadedImage& first_image,
                               const LoadedImage& second_image, TaskContext& context) {
  const ImageFeatures &first = first_image.features, &second = second_image.features;
  const auto matches = features::ComparesEqualSignsOnly(run.options.features)
                           ? matching::RunBySign(first, second, run.options.matching, context)
                           : matching::Run(first_image.prepared, second_image.prepared, run.options.matching, context);
  PairContext pair_context(context, first, second);
  const verification::Input input{{ImageId(0), ImageId(1)},
                                  run.block.camera_of(pair.first),
                                  run.block.camera_of(pair.second),
                                  first.keypoints,
                                  second.keypoints,
                                  matches};
  TwoViewGeometry geometry = verification::Run(input, run.options.verification, pair_context);
  geometry.matches = static_cast<std::uint32_t>(matches.size());
  return geometry;
}

/// The features of the images of a block of columns while its tiles run. Its own task fills it, the last tile empties
/// it.
struct ResidentBlock {
  std::vector<ImageId> images;  ///< sorted
  std::vector<LoadedImage> features;
  std::atomic<std::size_t> tiles_left{0};
};

/// The features of a tile: those of its columns from the resident block, the others loaded.
class TileFeatures {
 public:
  TileFeatures(const OrientRun& run, const PairTile& tile, const ResidentBlock& resident, TaskContext& context) {
    loaded_.reserve(tile.images.size());
    for (const ImageId id : tile.images) {
      const LoadedImage* features = Find(resident, id);
      if (features == nullptr) {
        loaded_.push_back(Load(run, id, context));
        features = &loaded_.back();
      }
      by_image_.emplace_back(id, features);
    }
  }
  const LoadedImage& operator[](ImageId id) const {
    return *std::lower_bound(by_image_.begin(), by_image_.end(), id, [](const auto& a, ImageId b) {
              return a.first < b;
            })->second;
  }

 private:
  static const LoadedImage* Find(const ResidentBlock& block, ImageId id) {
    const auto found = std::lower_bound(block.images.begin(), block.images.end(), id);
    if (block.features.empty() || found == block.images.end() || *found != id) return nullptr;
    return &block.features[static_cast<std::size_t>(found - block.images.begin())];
  }

  std::vector<LoadedImage> loaded_;
  std::vector<std::pair<ImageId, const LoadedImage*>> by_image_;
};

/// The results of all pairs of a tile; those that a former run has compared are taken over.
std::vector<TwoViewGeometry> CompareTile(const OrientRun& run, TileRun& slot, const ResidentBlock& resident,
                                         TaskContext& context) {
  const PairTile& tile = slot.tile;
  std::vector<std::optional<TwoViewGeometry>> known(tile.pairs.size());
  if (run.former) known = run.former->Find(tile, run.block, run.options, run.keys, run.store, context);
  slot.taken_over = static_cast<std::size_t>(
      std::count_if(known.begin(), known.end(), [](const auto& geometry) { return geometry.has_value(); }));
  std::optional<TileFeatures> features;
  if (slot.taken_over < known.size()) features.emplace(run, tile, resident, context);
  std::vector<TwoViewGeometry> pairs;
  for (std::size_t i = 0; i < known.size(); ++i) {
    context.ThrowIfStopped();
    const ImagePair& pair = tile.pairs[i];
    pairs.push_back(known[i] ? std::move(*known[i])
                             : MatchAndVerify(run, pair, (*features)[pair.first], (*features)[pair.second], context));
    context.ReportProgress(static_cast<double>(pairs.size()) / static_cast<double>(known.size()));
  }
  return pairs;
}

void RunPairTask(OrientRun& run, TileRun& slot, const ResidentBlock& resident, TaskContext& context) {
  const PairTile& tile = slot.tile;
  if (const auto payload = ReadCounted(run.store, slot.key, context)) {
    for (const auto& geometry : LoadTile(tile, *payload)) slot.pairs.push_back(Summarise(geometry));
    slot.reused = true;
    slot.taken_over = tile.pairs.size();
    context.MarkReused();
    return;
  }
  std::vector<TwoViewGeometry> pairs = CompareTile(run, slot, resident, context);
  PublishCounted(run.store, slot.key, io::Serialize(pairs), context);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    pairs[i].pair = tile.pairs[i];
    slot.pairs.push_back(Summarise(pairs[i]));
  }
}

/// Loads a block unless every tile of its column is on disk, sound.
void RunBlockTask(const OrientRun& run, ResidentBlock& block, std::span<const std::shared_ptr<TileRun>> column,
                  TaskContext& context) {
  const bool done =
      std::all_of(column.begin(), column.end(), [&](const auto& tile) { return run.store.Verify(tile->key); });
  if (done) return context.MarkReused();
  for (const ImageId id : block.images) {
    context.ThrowIfStopped();
    block.features.push_back(Load(run, id, context));
  }
}

/// The images of a column: those of its tiles that lie in its block.
std::vector<ImageId> ColumnImages(std::span<const std::shared_ptr<TileRun>> column, std::size_t edge) {
  std::set<ImageId> images;
  for (const auto& tile : column)
    for (const ImageId id : tile->tile.images)
      if (id.value / edge == tile->tile.column) images.insert(id);
  return {images.begin(), images.end()};
}

TaskId AddBlockTask(const std::shared_ptr<OrientRun>& run, const std::vector<std::shared_ptr<TileRun>>& column,
                    const std::shared_ptr<ResidentBlock>& block, engine::Plan& plan) {
  std::vector<TaskId> needs;
  for (const ImageId id : block->images) needs.push_back(run->feature_tasks[id.value]);
  const TaskCost cost = BlockTaskCost(*run, block->images.size());
  return plan.Add({.name = "block of pairs " + std::to_string(column.front()->number),
                   .stage = "blocks",
                   .needs = std::move(needs),
                   .cost = cost,
                   .retained_bytes = ResidentBlockBytes(*run, block->images.size()),
                   .units = {static_cast<double>(block->images.size()), "images"},
                   .memory_hint = MemoryHint(*run, cost.peak_bytes, "lower --max-features"),
                   .run = [run, block, column](TaskContext& context) { RunBlockTask(*run, *block, column, context); }});
}

/// `block_task` is that of the resident block, if there is one.
TaskId AddPairTask(const std::shared_ptr<OrientRun>& run, const std::shared_ptr<TileRun>& tile,
                   const std::shared_ptr<ResidentBlock>& block, std::optional<TaskId> block_task, engine::Plan& plan) {
  std::vector<TaskId> needs;
  for (const ImageId id : tile->tile.images) needs.push_back(run->feature_tasks[id.value]);
  if (block_task) needs.push_back(*block_task);
  TaskCost cost = PairTaskCost(*run, tile->tile, block_task.has_value());
  if (run->store.Exists(tile->key)) cost.work = 0;
  return plan.Add({.name = "pairs " + std::to_string(tile->number),
                   .stage = "pairs",
                   .needs = std::move(needs),
                   .cost = cost,
                   .units = {static_cast<double>(tile->tile.pairs.size()), "pairs"},
                   .memory_hint = MemoryHint(*run, cost.peak_bytes, "lower --max-features"),
                   .run = [run, tile, block](TaskContext& context) {
                     RunPairTask(*run, *tile, *block, context);
                     if (block->tiles_left.fetch_sub(1) == 1) block->features = {};
                   }});
}

}  // namespace

std::vector<TwoViewGeometry> LoadTile(const PairTile& tile, std::span<const std::byte> payload) {
  std::vector<TwoViewGeometry> pairs = io::DeserializePairs(payload);
  if (pairs.size() != tile.pairs.size())
    throw Error(ErrorCode::kInvalidInput, "", "a pair artifact does not fit its tile");
  for (std::size_t i = 0; i < pairs.size(); ++i) pairs[i].pair = tile.pairs[i];
  return pairs;
}

void AddColumn(const std::shared_ptr<OrientRun>& run, std::vector<std::shared_ptr<TileRun>> column,
               engine::Plan& plan) {
  const auto block = std::make_shared<ResidentBlock>();
  block->images = ColumnImages(column, TileEdge(run->block.images.size()));
  block->tiles_left = column.size();
  std::optional<TaskId> block_task;  // a single tile loads what it needs
  if (column.size() > 1) block_task = AddBlockTask(run, column, block, plan);
  for (const auto& tile : column) run->tile_tasks.push_back(AddPairTask(run, tile, block, block_task, plan));
}

void AddTiles(const std::shared_ptr<OrientRun>& run, const std::vector<ImagePair>& pairs, engine::Plan& plan) {
  std::vector<std::shared_ptr<TileRun>> column;
  for (PairTile& tile : TilePairs(pairs, TileEdge(run->block.images.size()))) {
    if (!column.empty() && column.back()->tile.column != tile.column) AddColumn(run, std::exchange(column, {}), plan);
    const engine::ArtifactKey key = TileKey(tile, run->block, run->options, run->keys);
    column.push_back(std::make_shared<TileRun>(TileRun{run->tiles.size(), std::move(tile), key, {}, false}));
    run->tiles.push_back(column.back());
  }
  if (!column.empty()) AddColumn(run, std::move(column), plan);
}

}  // namespace rilievo::scheduling
