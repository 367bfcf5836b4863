// Component after component: seeds, growth, last adjustment.
#include "stages/mapping/mapping.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numeric>
#include <optional>
#include <tuple>
#include <utility>

#include "stages/adjustment/adjustment.h"
#include "stages/mapping/doubts.h"
#include "stages/mapping/finish.h"
#include "stages/mapping/growth.h"
#include "stages/mapping/mapper_state.h"
#include "stages/mapping/reasons.h"
#include "stages/mapping/seeds.h"

namespace rilievo::mapping {
namespace {

constexpr int kMaxStarts = 40;  // seed pairs tried for one model, most fail at once
constexpr int kMaxGrowths = 3;  // seed pairs grown to the end before the best is taken

/// Sizes of the components that verified pairs make of the available images, per image.
std::vector<std::size_t> ComponentSizes(std::span<const TwoViewGeometry> pairs,
                                        const std::vector<std::uint8_t>& available) {
  std::vector<std::uint32_t> parent(available.size());
  std::iota(parent.begin(), parent.end(), 0U);
  const auto root = [&](std::uint32_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  for (const TwoViewGeometry& g : pairs)
    if (g.IsVerified() && available[g.pair.first.value] && available[g.pair.second.value])
      parent[root(g.pair.second.value)] = root(g.pair.first.value);
  std::vector<std::size_t> members(available.size(), 0), sizes(available.size(), 0);
  for (std::uint32_t i = 0; i < parent.size(); ++i) ++members[root(i)];
  for (std::uint32_t i = 0; i < parent.size(); ++i) sizes[i] = members[root(i)];
  return sizes;
}

using Keep = std::function<void()>;

/// True when a model from this seed may be better than the best so far.
bool IsWorthStarting(const MapperState& state, const SeedPair& seed, const std::vector<std::size_t>& component) {
  if (!state.available[seed.pair.first.value] || !state.available[seed.pair.second.value]) return false;
  // A seed inside the best model so far would grow to much the same one.
  const bool inside =
      state.best && state.best->IsRegistered(seed.pair.first) && state.best->IsRegistered(seed.pair.second);
  return !inside || state.best->NumRegistered() * 2 <= component[seed.pair.first.value];
}

/// Leaves the best model of the available images in state.best, or none.
void MapComponent(const GrowthInput& input, std::span<const SeedPair> seeds, std::span<const TwoViewGeometry> pairs,
                  MapperState& state, const Keep& keep, RunContext& context) {
  const std::vector<std::size_t> component = ComponentSizes(pairs, state.available);
  for (; state.next_seed < seeds.size(); ++state.next_seed) {
    const SeedPair& seed = seeds[state.next_seed];
    if (!state.growing) {
      if (!IsWorthStarting(state, seed, component)) continue;
      if (++state.starts > kMaxStarts) break;
      auto model = StartFromPair(input, seed, context);
      if (!model) continue;
      state.growing = GrowthState{std::move(*model), 0, {}};
    }
    Grow(input, *state.growing, keep, context);
    const Reconstruction& model = state.growing->model;
    if (!state.best || std::tuple(model.NumRegistered(), model.NumPoints()) >
                           std::tuple(state.best->NumRegistered(), state.best->NumPoints()))
      state.best = std::move(state.growing->model);
    state.growing.reset();
    if (5 * state.best->NumRegistered() >= 4 * component[seed.pair.first.value] || ++state.growths >= kMaxGrowths)
      break;
  }
}

/// Finishes the next model and takes its images out. False when there is none left.
bool MapNext(const GrowthInput& input, const Input& data, std::span<const SeedPair> seeds,
             std::span<const TwoViewGeometry> pairs, MapperState& state, const Keep& keep, RunContext& context) {
  if (!state.finishing) {
    MapComponent(input, seeds, pairs, state, keep, context);
    if (!state.best) return false;
    state.finishing = FinishState{std::move(*state.best), 0};
    state.best.reset();
  }
  auto model = Finish(input, data, *state.finishing, keep, context);
  // Whatever was tried is out of the next round, so that every round makes progress.
  for (const ImageId image : state.finishing->model.RegisteredImages()) state.available[image.value] = 0;
  state.finishing.reset();
  state.next_seed = state.starts = state.growths = 0;
  if (!model) return true;
  for (const auto& [image, pose] : model->cam_from_world) state.available[image.value] = 0;
  if (model->cam_from_world.size() >= static_cast<std::size_t>(input.options.min_model_images))
    state.models.push_back(std::move(*model));
  return true;
}

}  // namespace

std::span<const OptionDeclaration<Options>> OptionDeclarations() {
  static const std::array<OptionDeclaration<Options>, 4> kDeclarations{{
      {"max-residual", &Options::max_residual_px, 0.1, 100, "px",
       "largest residual of a ray in resection and intersection"},
      {"min-angle", &Options::min_angle_deg, 0.05, 45, "deg", "least intersection angle of an object point"},
      {"min-resection-inliers", &Options::min_resection_inliers, 6, 1000, "",
       "object points that must agree to orient an image"},
      {"min-model-images", &Options::min_model_images, 2, 10000, "", "images of the smallest model that is kept"},
  }};
  return kDeclarations;
}

TaskCost Estimate(std::size_t images, std::size_t features_in_all, std::size_t matches_in_all) {
  // A track has at least two rays, every ray is a feature that was matched: rays are bounded by both.
  const std::size_t rays = std::min(features_in_all, 2 * matches_in_all), points = rays / 2;
  TaskCost cost = adjustment::Estimate(images, points, rays);
  // Sorted tracks, rays, state of two models and a copy, the model handed to the adjustment; the pairs sorted. Measured
  // in all, pairs left out: 850 bytes a ray in tracks of two, 600 in long ones.
  cost.peak_bytes += 100 * rays + 250 * points + 2000 * images + matches_in_all * sizeof(Match);
  // The last adjustments carry all rays, those on the way few: about three times the work of one alone. Measured 2e-5
  // s a ray.
  cost.work *= 3;
  // Of the features that could be in a track, those that are: the more matches, the more of them meet one that is.
  if (rays > 0) {
    const auto all = static_cast<double>(features_in_all);
    const double in_tracks = all * (1 - std::exp(-static_cast<double>(matches_in_all) / all));
    cost.work *= std::min(1.0, in_tracks / static_cast<double>(rays));
  }
  return cost;
}

Output Run(const Input& input, const Options& options, Checkpoints& checkpoints, RunContext& context) {
  context.ThrowIfStopped();
  std::vector<TwoViewGeometry> pairs(input.pairs.begin(), input.pairs.end());
  std::sort(pairs.begin(), pairs.end(), [](const auto& a, const auto& b) { return a.pair < b.pair; });
  const TieBlock ties = MakeTieBlock(input);
  const std::vector<SeedPair> seeds = SeedPairs(input, pairs);

  Output output;
  MapperState state;
  if (const auto kept = checkpoints.Last()) {
    state = DeserializeState(*kept, ties, context.Seed());
    output.images_taken_over = state.NumMapped();
  } else {
    state.available.assign(input.block.images.size(), 1);
  }
  const GrowthInput growth{input.block, ties, options, state.available};
  const Keep keep = [&] { checkpoints.Keep(Serialize(state)); };
  while (MapNext(growth, input, seeds, pairs, state, keep, context)) {
  }
  output.models = std::move(state.models);
  std::stable_sort(output.models.begin(), output.models.end(), [](const Model& a, const Model& b) {
    return std::tuple(a.cam_from_world.size(), a.points.size()) > std::tuple(b.cam_from_world.size(), b.points.size());
  });
  output.unoriented = UnorientedImages(input, pairs, output.models);
  output.warnings = Doubts(input, pairs, output.models, options.max_residual_px);
  context.ReportProgress(1);
  return output;
}

Output Run(const Input& input, const Options& options, RunContext& context) {
  NoCheckpoints none;
  return Run(input, options, none, context);
}

}  // namespace rilievo::mapping
