// The order of the tasks of an orientation run.
#include "scheduling/orient_plan.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "base/check.h"
#include "base/cpu.h"
#include "scheduling/feature_tasks.h"
#include "scheduling/guided_plan.h"
#include "scheduling/pair_tasks.h"

namespace rilievo::scheduling {
namespace {

using engine::TaskContext;

void Finish(const std::shared_ptr<OrientRun>& run, TaskId gathered, engine::Plan& plan) {
  if (run->goal == Goal::kOrientation) AddOrientationTask(run, gathered, plan);
}

/// Features, each column of tiles right after its last image, and what gathers them.
void AddKnownTasks(const std::shared_ptr<OrientRun>& run, engine::Plan& plan) {
  const std::size_t edge = TileEdge(run->block.images.size());
  auto next = run->tiles.begin();
  for (const Image& image : run->block.images) {
    run->feature_tasks.push_back(AddFeatureTask(run, image, plan));
    const std::size_t column = image.id.value / edge;
    const bool is_last = (image.id.value + 1) % edge == 0 || image.id.value + 1 == run->block.images.size();
    const auto end =
        std::find_if(next, run->tiles.end(), [&](const auto& tile) { return tile->tile.column != column; });
    if (is_last && next != end) AddColumn(run, {std::exchange(next, end), end}, plan);
  }
  RILIEVO_CHECK(run->tile_tasks.size() == run->tiles.size());
  std::vector<TaskId> all = run->feature_tasks;
  all.insert(all.end(), run->tile_tasks.begin(), run->tile_tasks.end());
  const TaskId gathered(static_cast<std::uint32_t>(plan.size()));
  plan.Add({.name = "gather",
            .stage = "gather",
            .needs = std::move(all),
            .cost = {},
            .memory_hint = "",
            .run = [run, gathered](TaskContext& context) {
              context.Grow([run, gathered](engine::Plan& grown) { Finish(run, gathered, grown); });
            }});
}

}  // namespace

OrientRun::OrientRun(const Block& b, const PixelSource& p, const PixelSource* m, const engine::ArtifactStore& s,
                     OrientOptions o, std::uint64_t overhead)
    : block(b),
      pixels(p),
      masks(m),
      store(s),
      options(std::move(o)),
      keys(ComputeKeys(b, options, ProcessorLevel())),
      images(b.images.size()),
      overhead_bytes(overhead) {}

OrientRun::OrientRun(const OrientRun& planned, const engine::ArtifactStore& s)
    : block(planned.block),
      pixels(planned.pixels),
      masks(planned.masks),
      store(s),
      options(planned.options),
      keys(planned.keys),
      images(planned.images.size()),
      overhead_bytes(planned.overhead_bytes),
      budget_bytes(planned.budget_bytes),
      strip_width_px(planned.strip_width_px),
      goal(planned.goal) {}

engine::Plan MakeOrientPlan(std::shared_ptr<OrientRun> run) {
  engine::Plan plan;
  if (run->options.network == Network::kGuided) {
    AddGuidedTasks(run, plan, [run](TaskId gathered, engine::Plan& grown) { Finish(run, gathered, grown); });
    return plan;
  }
  for (std::size_t t = 0; t < run->keys.tiles.size(); ++t)
    run->tiles.push_back(std::make_shared<TileRun>(TileRun{t, run->keys.tiles[t], run->keys.pairs[t], {}, false}));
  AddKnownTasks(run, plan);
  return plan;
}

}  // namespace rilievo::scheduling
