// The incremental loop.
#include "stages/mapping/growth.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "base/rng.h"
#include "base/units.h"
#include "geometry/resection.h"
#include "stages/mapping/bundle.h"

namespace rilievo::mapping {
namespace {

constexpr int kMinSeedPoints = 15;
constexpr double kGlobalGrowth = 1.2;  // images or points, since the last global adjustment

struct ResectionBar {
  int min_inliers = 30;
  double min_ratio = 0.25;
};

double LossScale(const Options& options) { return 0.25 * options.max_residual_px; }

/// Registers the image when enough of its visible points agree; takes the agreeing rays in.
bool Resect(const GrowthInput& input, Reconstruction& model, ImageId image, const ResectionBar& bar,
            RunContext& context) {
  const TieBlock& ties = input.ties;
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector2d> normalized;
  std::vector<std::uint32_t> tracks;
  for (const std::uint32_t ray : ties.rays_of_image[image.value]) {
    if (!model.HasPoint(ties.rays[ray].track)) continue;
    points.push_back(model.position(ties.rays[ray].track));
    normalized.push_back(ties.rays[ray].normalized);
    tracks.push_back(ties.rays[ray].track);
  }
  ResectionOptions options;
  options.max_residual_px = input.options.max_residual_px;
  options.context = &context;
  const auto resection = EstimateResection({points, normalized, ties.focal_px[image.value]}, options,
                                           SeedFor(context.Seed(), image.value, points.size()));
  if (!resection) return false;
  const auto inliers = static_cast<double>(resection->inliers.size());
  if (inliers < bar.min_inliers || inliers < bar.min_ratio * static_cast<double>(points.size())) return false;
  model.SetPose(image, resection->cam_from_world);
  const PointTolerance tolerance = ToleranceOf(input.options);
  for (const std::uint32_t item : resection->inliers) model.Intersect(tracks[item], tolerance);
  return true;
}

void IntersectNewPoints(const GrowthInput& input, Reconstruction& model, ImageId image) {
  const PointTolerance tolerance = ToleranceOf(input.options);
  for (const std::uint32_t ray : input.ties.rays_of_image[image.value])
    model.Intersect(input.ties.rays[ray].track, tolerance);
}

int IntersectAll(const GrowthInput& input, Reconstruction& model, const RunContext& context) {
  constexpr std::uint32_t kTracksBetweenPolls = 4096;
  const PointTolerance tolerance = ToleranceOf(input.options);
  int added = 0;
  for (std::uint32_t track = 0; track < input.ties.NumTracks(); ++track) {
    if (track % kTracksBetweenPolls == 0) context.ThrowIfStopped();
    added += model.Intersect(track, tolerance);
  }
  return added;
}

int FilterAll(Reconstruction& model, const PointTolerance& tolerance) {
  int dropped = 0;
  for (const std::uint32_t track : model.Tracks()) dropped += model.Filter(track, tolerance);
  return dropped;
}

/// Images whose rays in use are fewer than a resection needs. One at a time, the weakest first: others may live on its
/// loss.
int DropWeakImages(const GrowthInput& input, Reconstruction& model) {
  int dropped = 0;
  while (model.NumRegistered() > 2) {
    std::pair<std::uint32_t, ImageId> weakest{~0U, ImageId()};
    for (const ImageId image : model.RegisteredImages()) weakest = std::min(weakest, {model.NumUsed(image), image});
    if (weakest.first >= static_cast<std::uint32_t>(input.options.min_resection_inliers)) break;
    model.RemoveImage(weakest.second);
    ++dropped;
  }
  return dropped;
}

std::optional<ImageId> NextImage(const GrowthInput& input, const Reconstruction& model,
                                 const std::vector<std::uint32_t>& failed_at, int min_inliers) {
  const TieBlock& ties = input.ties;
  std::uint32_t most = 0;
  std::vector<ImageId> candidates;
  for (std::uint32_t i = 0; i < ties.NumImages(); ++i) {
    const ImageId image(i);
    const std::uint32_t visible = model.NumVisible(image);
    if (!input.available[i] || model.IsRegistered(image) || visible < static_cast<std::uint32_t>(min_inliers)) continue;
    if (failed_at[i] > 0 && visible < failed_at[i] + failed_at[i] / 5 + 1) continue;
    candidates.push_back(image);
    most = std::max(most, visible);
  }
  std::optional<ImageId> best;
  std::tuple<std::int64_t, std::uint32_t> best_score{-1, 0};
  for (const ImageId image : candidates) {
    if (2 * model.NumVisible(image) < most) continue;
    std::vector<Eigen::Vector2d> positions_px;
    for (const std::uint32_t ray : ties.rays_of_image[image.value])
      if (model.HasPoint(ties.rays[ray].track)) positions_px.push_back(ties.rays[ray].measured_px);
    const std::tuple score{CoverageScore(input.block.camera_of(image), positions_px), model.NumVisible(image)};
    if (score > best_score) best_score = score, best = image;
  }
  return best;
}

/// Notes the size of the model: at a fifth more it is adjusted as a whole again.
void NoteSize(GrowthState& state) {
  state.images_then = state.model.NumRegistered();
  state.points_then = state.model.NumPoints();
}

bool HasGrown(const GrowthState& state) {
  const auto grown = [](std::size_t now, std::uint64_t then) {
    return static_cast<double>(now) >= kGlobalGrowth * static_cast<double>(then);
  };
  return grown(state.model.NumRegistered(), state.images_then) || grown(state.model.NumPoints(), state.points_then);
}

/// Adjusts around a new image and filters its points.
void SettleLocally(const GrowthInput& input, Reconstruction& model, ImageId image, RunContext& context) {
  AdjustLocally(input.block, model, image, LossScale(input.options), context);
  const PointTolerance tolerance = ToleranceOf(input.options);
  for (const std::uint32_t ray : input.ties.rays_of_image[image.value])
    if (model.HasPoint(input.ties.rays[ray].track)) model.Filter(input.ties.rays[ray].track, tolerance);
}

/// Adds images under one bar until none passes it; counts them in state.added. An image that failed is tried again when
/// it has a fifth more to offer.
void GrowUnder(const GrowthInput& input, GrowthState& state, const ResectionBar& bar, const std::function<void()>& keep,
               RunContext& context) {
  Reconstruction& model = state.model;
  if (state.failed_at.empty()) {
    state.failed_at.assign(input.ties.NumImages(), 0);
    state.added = 0;
    NoteSize(state);
  }
  while (const auto image = NextImage(input, model, state.failed_at, bar.min_inliers)) {
    context.ThrowIfStopped();
    if (!Resect(input, model, *image, bar, context)) {
      state.failed_at[image->value] = model.NumVisible(*image);
      continue;
    }
    ++state.added;
    IntersectNewPoints(input, model, *image);
    context.ReportProgress(static_cast<double>(model.NumRegistered()) /
                           static_cast<double>(input.ties.NumImages() + 1));
    const bool global = HasGrown(state);
    if (global) {
      Settle(input, model, 1, context);
      NoteSize(state);
    } else {
      SettleLocally(input, model, *image, context);
    }
    if (!model.IsRegistered(*image) || model.NumUsed(*image) < static_cast<std::uint32_t>(bar.min_inliers)) {
      if (model.IsRegistered(*image)) model.RemoveImage(*image);
      state.failed_at[image->value] = std::max(1U, model.NumVisible(*image));
      --state.added;
    }
    if (global) keep();
  }
}

}  // namespace

PointTolerance ToleranceOf(const Options& options) {
  return {options.max_residual_px, DegToRad(options.min_angle_deg)};
}

std::int64_t CoverageScore(const Camera& camera, std::span<const Eigen::Vector2d> positions_px) {
  std::int64_t score = 0;
  for (int level = 1; level <= 5; ++level) {
    const int side = 1 << level;
    std::vector<std::uint8_t> occupied(static_cast<std::size_t>(side * side), 0);
    const auto cell = [side](double x, int size) { return std::clamp(static_cast<int>(x / size * side), 0, side - 1); };
    for (const Eigen::Vector2d& p : positions_px)
      occupied[static_cast<std::size_t>(cell(p.y(), camera.height_px) * side + cell(p.x(), camera.width_px))] = 1;
    score += side * std::count(occupied.begin(), occupied.end(), std::uint8_t{1});
  }
  return score;
}

std::optional<Reconstruction> StartFromPair(const GrowthInput& input, const SeedPair& seed, RunContext& context) {
  context.ThrowIfStopped();
  Reconstruction model(input.ties, context.Seed());
  model.SetPose(seed.pair.first, Rigid3());
  model.SetPose(seed.pair.second, seed.second_from_first);
  // Points of narrow pairs are needed to begin with; later filters hold them to the full angle.
  const int tier = seed.tier % kTiersOfAKind;
  PointTolerance tolerance = ToleranceOf(input.options);
  if (tier >= 2) tolerance.min_angle_rad = std::min(tolerance.min_angle_rad, DegToRad(0.3));
  const auto enough = [&] {
    return model.NumPoints() >= static_cast<std::size_t>(std::max(kMinSeedPoints, input.options.min_resection_inliers));
  };
  for (int round = 0; round < 2; ++round) {
    for (const std::uint32_t ray : input.ties.rays_of_image[seed.pair.first.value])
      model.Intersect(input.ties.rays[ray].track, tolerance);
    if (!enough()) return std::nullopt;
    AdjustGlobally(input.block, model, {.loss_scale_px = LossScale(input.options)}, context);
    FilterAll(model, tolerance);
  }
  if (!enough()) return std::nullopt;
  return model;
}

void Settle(const GrowthInput& input, Reconstruction& model, int rounds, RunContext& context) {
  for (int round = 0; round < rounds; ++round) {
    context.ThrowIfStopped();
    AdjustGlobally(input.block, model, {.loss_scale_px = LossScale(input.options)}, context);
    int changed = FilterAll(model, ToleranceOf(input.options));
    changed += DropWeakImages(input, model);
    changed += IntersectAll(input, model, context);
    if (changed < 0.005 * static_cast<double>(2 * model.NumPoints())) break;
  }
}

void Grow(const GrowthInput& input, GrowthState& state, const std::function<void()>& keep, RunContext& context) {
  const ResectionBar relaxed{input.options.min_resection_inliers, 0.1};
  const ResectionBar strict{std::max(30, input.options.min_resection_inliers), 0.25};
  constexpr std::uint32_t kPhases = 1 + 3 * 3;
  while (state.phase < kPhases) {
    const bool settles = state.phase % 3 == 1, relaxes = state.phase % 3 == 2;
    if (settles)
      Settle(input, state.model, 2, context);
    else
      GrowUnder(input, state, relaxes ? relaxed : strict, keep, context);
    // A relaxed image may open the way to images that pass the strict bar again.
    state.phase = relaxes && state.added == 0 ? kPhases : state.phase + 1;
    state.failed_at.clear();
    if (settles) keep();
  }
}

}  // namespace rilievo::mapping
