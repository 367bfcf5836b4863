// Final adjustment, rejection at three sigma, datum, colours.
#include "stages/mapping/finish.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "geometry/similarity3.h"
#include "stages/mapping/bundle.h"

namespace rilievo::mapping {
namespace {

/// Length of a two-dimensional residual, in sigma of one coordinate, that one in a thousand exceeds: sqrt(13.8)
/// (SPEC 5.4).
constexpr double kRejection = 3.717;
/// Points of the last robust adjustment: denser than on the way, since it decides what is rejected.
constexpr int kFinalCells = 1600;

/// Robust sigma of an image coordinate, px: residuals are two-dimensional normal, whose length has the median
/// sigma sqrt(2 ln 2); corrected for redundancy as sigma0 is.
double RobustSigma(const Reconstruction& model) {
  std::vector<double> residuals_px;
  for (const std::uint32_t track : model.Tracks())
    for (const RayView& view : model.UsedViews(track))
      residuals_px.push_back(RayResidualPx(view, model.position(track)));
  if (residuals_px.empty()) return 0;
  const auto middle = residuals_px.begin() + static_cast<std::ptrdiff_t>(residuals_px.size() / 2);
  std::nth_element(residuals_px.begin(), middle, residuals_px.end());
  const double observations = 2.0 * static_cast<double>(residuals_px.size());
  const double redundancy = observations - 3.0 * static_cast<double>(model.NumPoints()) -
                            6.0 * static_cast<double>(model.NumRegistered()) + 7;
  return *middle / std::sqrt(2 * std::log(2.0)) * std::sqrt(observations / std::max(redundancy, 0.1 * observations));
}

void ColorPoints(std::span<const std::vector<Rgb>> colors, Model& model) {
  for (Point& point : model.points) {
    std::array<std::uint32_t, 3> sum{};
    std::uint32_t count = 0;
    for (const Observation& o : point.observations) {
      if (o.feature.image.value >= colors.size() || o.feature.feature >= colors[o.feature.image.value].size()) continue;
      for (std::size_t c = 0; c < 3; ++c) sum[c] += colors[o.feature.image.value][o.feature.feature][c];
      ++count;
    }
    for (std::size_t c = 0; c < 3 && count > 0; ++c)
      point.color[c] = static_cast<std::uint8_t>((sum[c] + count / 2) / count);
  }
}

/// Rejects what does not fit `tolerance`; images left with too few rays go with it.
int Reject(const GrowthInput& input, Reconstruction& model, const PointTolerance& tolerance) {
  int dropped = 0;
  for (const std::uint32_t track : model.Tracks()) dropped += model.Filter(track, tolerance);
  for (const ImageId image : model.RegisteredImages())
    if (model.NumRegistered() > 2 &&
        model.NumUsed(image) < static_cast<std::uint32_t>(input.options.min_resection_inliers))
      model.RemoveImage(image);
  return dropped;
}

}  // namespace

void NormalizeDatum(Model& model) {
  if (model.cam_from_world.empty()) return;
  const auto n = static_cast<double>(model.cam_from_world.size());
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  for (const auto& [id, pose] : model.cam_from_world) origin += pose.Center() / n;
  double distance = 0;
  for (const auto& [id, pose] : model.cam_from_world) distance += (pose.Center() - origin).norm() / n;
  Similarity3 datum_from_world;
  datum_from_world.rotation = model.cam_from_world.begin()->second.rotation;
  datum_from_world.scale = distance > 0 ? 1 / distance : 1;
  datum_from_world.translation = -datum_from_world.scale * (datum_from_world.rotation * origin);
  for (auto& [id, pose] : model.cam_from_world) pose = TransformPose(datum_from_world, pose);
  for (Point& point : model.points) point.position = datum_from_world * point.position;
}

std::optional<Model> Finish(const GrowthInput& input, const Input& data, FinishState& state,
                            const std::function<void()>& keep, RunContext& context) {
  Reconstruction& model = state.model;
  const double floor_px = 0.1 * input.options.max_residual_px;  // positions are rounded, models are not exact
  const auto reject = [&] {
    PointTolerance tolerance = ToleranceOf(input.options);
    tolerance.max_residual_px = std::clamp(kRejection * RobustSigma(model), floor_px, input.options.max_residual_px);
    return Reject(input, model, tolerance);
  };
  adjustment::Options options;
  options.function_tolerance = 1e-5;
  constexpr std::uint32_t kSteps = 2 + 4;
  while (state.step < kSteps) {
    bool settled = false;
    if (state.step == 0) {
      Settle(input, model, 3, context);
    } else if (state.step == 1) {
      const double loss_scale_px = std::max(0.5 * floor_px, 1.5 * RobustSigma(model));
      AdjustGlobally(input.block, model, {kFinalCells, loss_scale_px, 1e-5}, context);
      reject();
    } else {
      Adjust(input.block, model, model.Tracks(), options, context);
      // The few that later rounds would find do not move anything; the last adjustment follows anyway.
      settled = reject() < static_cast<int>(model.NumPoints() / 1000 + 1);
    }
    state.step = settled ? kSteps : state.step + 1;
    keep();
  }
  const auto images = model.RegisteredImages();
  const auto tracks = model.Tracks();
  if (images.size() < 2 || tracks.empty()) return std::nullopt;
  Model result = ToModel(model, tracks);
  options.max_iterations = 100;
  options.function_tolerance = 1e-9;
  adjustment::Run(input.block, result, options, context);
  NormalizeDatum(result);
  ColorPoints(data.colors, result);
  return result;
}

}  // namespace rilievo::mapping
