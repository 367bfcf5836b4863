// Component after component: seeds, growth, last adjustment.
#include "stages/mapping/mapping.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>
#include <tuple>

#include "stages/adjustment/adjustment.h"
#include "stages/mapping/doubts.h"
#include "stages/mapping/finish.h"
#include "stages/mapping/growth.h"
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

/// The best model of the available images, or none.
std::optional<Reconstruction> MapComponent(const GrowthInput& input, std::span<const SeedPair> seeds,
                                           std::span<const TwoViewGeometry> pairs, RunContext& context) {
  const std::vector<std::size_t> component = ComponentSizes(pairs, input.available);
  std::optional<Reconstruction> best;
  int starts = 0, growths = 0;
  for (const SeedPair& seed : seeds) {
    if (!input.available[seed.pair.first.value] || !input.available[seed.pair.second.value]) continue;
    // A seed inside the best model so far would grow to much the same one.
    if (best && best->IsRegistered(seed.pair.first) && best->IsRegistered(seed.pair.second)) {
      const std::size_t reachable = component[seed.pair.first.value];
      if (best->NumRegistered() * 2 > reachable) continue;
    }
    if (++starts > kMaxStarts) break;
    auto model = StartFromPair(input, seed, context);
    if (!model) continue;
    Grow(input, *model, context);
    if (!best ||
        std::tuple(model->NumRegistered(), model->NumPoints()) > std::tuple(best->NumRegistered(), best->NumPoints()))
      best = std::move(model);
    if (5 * best->NumRegistered() >= 4 * component[seed.pair.first.value] || ++growths >= kMaxGrowths) break;
  }
  return best;
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

Output Run(const Input& input, const Options& options, RunContext& context) {
  context.ThrowIfStopped();
  std::vector<TwoViewGeometry> pairs(input.pairs.begin(), input.pairs.end());
  std::sort(pairs.begin(), pairs.end(), [](const auto& a, const auto& b) { return a.pair < b.pair; });
  const TieBlock ties = MakeTieBlock(input);
  const std::vector<SeedPair> seeds = SeedPairs(input, pairs);
  std::vector<std::uint8_t> available(input.block.images.size(), 1);
  const GrowthInput growth{input.block, ties, options, available};

  Output output;
  while (auto reconstruction = MapComponent(growth, seeds, pairs, context)) {
    auto model = Finish(growth, input, *reconstruction, context);
    // Whatever was tried is out of the next round, so that every round makes progress.
    for (const ImageId image : reconstruction->RegisteredImages()) available[image.value] = 0;
    if (!model) continue;
    for (const auto& [image, pose] : model->cam_from_world) available[image.value] = 0;
    if (model->cam_from_world.size() >= static_cast<std::size_t>(options.min_model_images))
      output.models.push_back(std::move(*model));
  }
  std::stable_sort(output.models.begin(), output.models.end(), [](const Model& a, const Model& b) {
    return std::tuple(a.cam_from_world.size(), a.points.size()) > std::tuple(b.cam_from_world.size(), b.points.size());
  });
  output.unoriented = UnorientedImages(input, pairs, output.models);
  output.warnings = Doubts(input, pairs, output.models, options.max_residual_px);
  context.ReportProgress(1);
  return output;
}

}  // namespace rilievo::mapping
