// Decides what geometry a pair has: essential matrix, fundamental matrix, homography, or none.
#include "stages/verification/verification.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "base/rng.h"
#include "geometry/epipolar.h"
#include "geometry/essential_refinement.h"
#include "geometry/robust/estimate.h"
#include "geometry/robust/significance.h"
#include "geometry/robust/two_view_problems.h"
#include "geometry/solvers/homography.h"
#include "stages/verification/correspondences.h"

namespace rilievo::verification {
namespace {

// Sampson's distance has one degree of freedom, a homography's has two: 95 % quantiles 3.84 and 5.99, and the transfer
// of one image into the other carries the noise of both, so its mean square is twice Sampson's.
constexpr double kTransferFactor = 1.766;  // sqrt(2 * 5.99 / 3.84)
// sigma0 of LMedS over both distances is about twice the standard deviation of Sampson's distance.
constexpr double kLmedsToSampson = 0.5;
constexpr double kBreakdown = 4;  // a bound of LMedS that many thresholds wide: more than half of the matches are wrong
constexpr double kLogSignificance = -13.8;  // at most one in a million unrelated pairs

constexpr double kRotationShare = 0.9;  // of the inliers, from which on a rotation explains the pair

struct Epipolar {
  Eigen::Matrix3d matrix;              // in ideal coordinates
  std::vector<std::uint32_t> inliers;  // items of the correspondences
  double threshold_px = 0;             // as Sampson distance
};

RobustEstimator EstimatorOf(const Options& options) {
  if (options.estimator == "ransac") return RobustEstimator::kRansac;
  return options.estimator == "lmeds" ? RobustEstimator::kLmeds : RobustEstimator::kMapsac;
}

RobustOptions LoopOptions(const Options& options, const RunContext& context) {
  RobustOptions loop;
  loop.estimator = EstimatorOf(options);
  loop.threshold = options.threshold_px;
  loop.noise_floor = 0.1;
  loop.confidence = options.confidence;
  loop.max_trials = options.max_trials;
  loop.context = &context;
  return loop;
}

double SampsonThreshold(const RobustOptions& loop, double threshold) {
  return loop.estimator == RobustEstimator::kLmeds ? kLmedsToSampson * threshold : threshold;
}

std::vector<std::uint32_t> SampsonInliers(const PointPairs& pairs, const Eigen::Matrix3d& matrix, double threshold_px) {
  std::vector<std::uint32_t> inliers;
  for (std::uint32_t i = 0; i < pairs.Size(); ++i) {
    if (SquaredSampson(matrix, pairs.First()[i], pairs.Second()[i], pairs.Variances()) <= threshold_px * threshold_px) {
      inliers.push_back(i);
    }
  }
  return inliers;
}

/// How probably a wrong match agrees with the model, never below the area of a band of the threshold's width.
double Chance(const PointPairs& pairs, const Eigen::Matrix3d& matrix, double threshold_px, const Camera& camera) {
  const double width = std::max(1, camera.width_px), height = std::max(1, camera.height_px);
  const double band = 2 * threshold_px * std::hypot(width, height) / (width * height);
  return std::max(ChanceAgreement(pairs, matrix, threshold_px), std::min(band, 0.5));
}

bool IsSignificant(const PointPairs& pairs, const Epipolar& model, int sample_size, int models_a_sample, int trials,
                   const Camera& camera) {
  const double chance = Chance(pairs, model.matrix, model.threshold_px, camera);
  const double tests = 10.0 * models_a_sample * std::max(trials, 100);  // local optimisation looks around each model
  return LogFalseAlarms(model.inliers.size(), pairs.Size(), static_cast<std::size_t>(sample_size), chance, tests,
                        kLogSignificance) < kLogSignificance;
}

std::optional<Epipolar> EstimateEssential(const PointPairs& pairs, const RobustOptions& loop, const Camera& camera,
                                          std::uint64_t seed, bool& any_model) {
  const bool lmeds = loop.estimator == RobustEstimator::kLmeds;
  const EssentialProblem problem(pairs, lmeds ? EpipolarResidual::kBothDistances : EpipolarResidual::kSampson);
  const auto estimate = EstimateRobustly(problem, loop, seed);
  any_model = estimate.has_value();
  if (!estimate) return std::nullopt;
  Epipolar result{estimate->model, {}, SampsonThreshold(loop, estimate->threshold)};
  if (result.threshold_px > kBreakdown * loop.threshold) return std::nullopt;
  // The closing adjustment, on the inliers, to convergence.
  if (const auto refined = RefineEssential(pairs.Arrays(estimate->inliers), pairs.Variances(), estimate->model)) {
    result.matrix = *refined;
  }
  result.inliers = SampsonInliers(pairs, result.matrix, result.threshold_px);
  if (!IsSignificant(pairs, result, EssentialProblem::kSampleSize, 10, estimate->trials, camera)) return std::nullopt;
  return result;
}

std::optional<Epipolar> EstimateFundamental(const PointPairs& pairs, const RobustOptions& loop, const Camera& camera,
                                            std::uint64_t seed) {
  const bool lmeds = loop.estimator == RobustEstimator::kLmeds;
  const FundamentalProblem problem(pairs, lmeds ? EpipolarResidual::kBothDistances : EpipolarResidual::kSampson);
  const auto estimate = EstimateRobustly(problem, loop, seed);
  if (!estimate) return std::nullopt;
  Epipolar result{estimate->model, {}, SampsonThreshold(loop, estimate->threshold)};
  if (result.threshold_px > kBreakdown * loop.threshold) return std::nullopt;
  result.inliers = SampsonInliers(pairs, result.matrix, result.threshold_px);
  if (!IsSignificant(pairs, result, FundamentalProblem::kSampleSize, 3, estimate->trials, camera)) return std::nullopt;
  return result;
}

struct PlaneFit {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();  // ideal coordinates
  double share = 0;                                  // of the epipolar inliers
};

/// The homography that most of the epipolar inliers agree with. A share too small to matter is not searched to the end.
PlaneFit FitPlane(const PointPairs& inliers, double threshold_px, const RobustOptions& loop, std::uint64_t seed) {
  constexpr int kTrials = 500;
  RobustOptions options = loop;
  options.estimator = RobustEstimator::kMapsac;
  options.threshold = kTransferFactor * threshold_px;
  options.max_trials = std::min(options.max_trials, kTrials);
  const auto estimate = EstimateRobustly(HomographyProblem(inliers), options, seed);
  if (!estimate) return {};
  return {estimate->model.matrix, static_cast<double>(estimate->inliers.size()) / static_cast<double>(inliers.Size())};
}

/// The rotation that nearly all of the inliers agree with to within the threshold: then there is no parallax to speak
/// of.
std::optional<Eigen::Matrix3d> PureRotation(const PointPairs& inliers, double threshold_px, const RobustOptions& loop,
                                            std::uint64_t seed) {
  constexpr int kTrials = 30;  // 0.9^2 of the samples are good
  RobustOptions options = loop;
  options.estimator = RobustEstimator::kMapsac;
  options.threshold = kTransferFactor * threshold_px;
  options.max_trials = std::min(options.max_trials, kTrials);
  const auto estimate = EstimateRobustly(RotationProblem(inliers), options, seed);
  if (!estimate || static_cast<double>(estimate->inliers.size()) < kRotationShare * static_cast<double>(inliers.Size()))
    return std::nullopt;
  return estimate->model.matrix;
}

Eigen::Matrix3d CalibrationMatrix(const CameraModel& model) {
  Eigen::Matrix3d k;
  k << model.fx, 0, model.cx, 0, model.fy, model.cy, 0, 0, 1;
  return k;
}

Eigen::Matrix3d HomographyInPixels(const Eigen::Matrix3d& h, const Input& input) {
  const Eigen::Matrix3d pixels =
      CalibrationMatrix(input.camera_second.model) * h * CalibrationMatrix(input.camera_first.model).inverse();
  return pixels / pixels.norm();
}

Eigen::Matrix3d FundamentalInPixels(const Eigen::Matrix3d& f, const Input& input) {
  const Eigen::Matrix3d pixels = CalibrationMatrix(input.camera_second.model).inverse().transpose() * f *
                                 CalibrationMatrix(input.camera_first.model).inverse();
  return pixels / pixels.norm();
}

double Median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::vector<Match> MatchesOf(const Correspondences& all, const std::vector<std::uint32_t>& items,
                             std::span<const Match> matches) {
  std::vector<Match> result;
  for (const auto i : items) {
    for (const auto index : all.MatchesOf(i)) result.push_back(matches[index]);
  }
  std::sort(result.begin(), result.end());
  return result;
}

struct Orientation {
  Rigid3 second_from_first;
  Epipolar model;  // with the inliers in front of both cameras only
  double median_angle_rad = 0;
};

/// Relative pose, intersection angles and the inliers in front of both cameras. A ray pair whose angle is within the
/// noise says nothing about front and back and stays.
Orientation Orient(const PointPairs& pairs, const Epipolar& model) {
  const PointPairs inliers = pairs.Subset(model.inliers);
  Orientation result{SelectPose(model.matrix, inliers.First(), inliers.Second()).second_from_first, model, 0};
  result.model.inliers.clear();
  const double noise_rad =
      3 * model.threshold_px * std::sqrt(0.5 * (pairs.Variances().first + pairs.Variances().second));
  std::vector<double> angles;
  for (std::size_t k = 0; k < inliers.Size(); ++k) {
    const auto rays = IntersectRays(result.second_from_first, inliers.First()[k], inliers.Second()[k]);
    if (!rays.in_front && rays.angle_rad > noise_rad) continue;
    result.model.inliers.push_back(model.inliers[k]);
    angles.push_back(rays.angle_rad);
  }
  result.median_angle_rad = Median(std::move(angles));
  return result;
}

/// A plane allows two poses, and the essential matrix found may be the wrong one, which puts points behind a camera:
/// takes the one with the most points in front. Each pose is refined on its own inliers: a wrong match that happens to
/// lie on an epipolar line of the one may be far from those of the other.
Orientation OrientPlanar(const PointPairs& pairs, const Epipolar& model, const Eigen::Matrix3d& plane) {
  Orientation best = Orient(pairs, model);
  for (const Rigid3& pose : DecomposeHomography(plane)) {
    const Eigen::Matrix3d start = EssentialFromPose(pose);
    const PairArrays inliers = pairs.Arrays(SampsonInliers(pairs, start, model.threshold_px));
    const auto refined = RefineEssential(inliers, pairs.Variances(), start);
    if (!refined) continue;
    const Epipolar candidate{*refined, SampsonInliers(pairs, *refined, model.threshold_px), model.threshold_px};
    Orientation other = Orient(pairs, candidate);
    if (other.model.inliers.size() > best.model.inliers.size()) best = std::move(other);
  }
  return best;
}

TwoViewGeometry Rejected(TwoViewGeometry geometry, RejectionReason reason) {
  TwoViewGeometry rejected;
  rejected.pair = geometry.pair;
  rejected.matches = geometry.matches;
  rejected.reason = reason;
  return rejected;
}

/// Fills in what a calibrated pair with an essential matrix is: rotation only, planar or general.
void DescribeCalibrated(const Input& input, const Options& options, const PointPairs& pairs, const RobustOptions& loop,
                        std::uint64_t seed, Epipolar& model, TwoViewGeometry& geometry) {
  const PointPairs inliers = pairs.Subset(model.inliers);
  const PlaneFit plane = FitPlane(inliers, model.threshold_px, loop, SeedFor(seed, 1));
  geometry.homography_ratio = plane.share;
  const bool planar = plane.share > options.planar_ratio;
  // A rotation is a homography: where less than that share lies on one, there is none.
  const bool may_rotate = plane.share > kRotationShare - 0.1;
  const auto rotation = may_rotate ? PureRotation(inliers, model.threshold_px, loop, SeedFor(seed, 2)) : std::nullopt;
  if (rotation) {
    geometry.model = TwoViewModel::kHomography;
    geometry.second_from_first = Rigid3(*rotation, Eigen::Vector3d::Zero());
    geometry.matrix = HomographyInPixels(*rotation, input);
    std::vector<double> angles;
    for (std::size_t k = 0; k < inliers.Size(); ++k) {
      angles.push_back(ParallaxAngle(geometry.second_from_first.rotation, inliers.First()[k], inliers.Second()[k]));
    }
    geometry.median_angle_rad = Median(std::move(angles));
    return;
  }
  Orientation orientation = planar ? OrientPlanar(pairs, model, plane.matrix) : Orient(pairs, model);
  model = std::move(orientation.model);
  geometry.model = planar ? TwoViewModel::kHomography : TwoViewModel::kEssential;
  geometry.second_from_first = orientation.second_from_first;
  geometry.matrix = model.matrix;
  geometry.median_angle_rad = orientation.median_angle_rad;
}

}  // namespace

std::span<const OptionDeclaration<Options>> OptionDeclarations() {
  static const std::array<OptionDeclaration<Options>, 6> kDeclarations{{
      {"verification-estimator",
       &Options::estimator,
       0,
       0,
       "",
       "robust estimator of the relative orientation",
       {"ransac", "lmeds", "mapsac"}},
      {"verification-threshold", &Options::threshold_px, 0.01, 100, "px",
       "largest Sampson distance of an inlier at full resolution; LMedS finds its own"},
      {"verification-confidence", &Options::confidence, 0.5, 0.999999, "",
       "probability of having drawn a sample free of outliers"},
      {"verification-max-trials", &Options::max_trials, 1, 10000000, "", "most samples drawn for a pair"},
      {"min-inliers", &Options::min_inliers, 6, 1000000, "", "fewest inliers (different positions) of a verified pair"},
      {"planar-ratio", &Options::planar_ratio, 0, 1, "",
       "share of the inliers on one homography above which a pair is planar or rotation only"},
  }};
  return kDeclarations;
}

TaskCost Estimate(std::size_t matches) {
  const auto n = static_cast<std::uint64_t>(matches);
  return {(std::uint64_t{1} << 16) + 1024 * n, 0.005 + 8e-6 * static_cast<double>(n)};
}

TwoViewGeometry Run(const Input& input, const Options& options, RunContext& context) {
  TwoViewGeometry geometry;
  geometry.pair = input.pair;
  geometry.matches = static_cast<std::uint32_t>(input.matches.size());
  const std::uint64_t seed = SeedFor(context.Seed(), input.pair.first.value, input.pair.second.value);
  const Correspondences all = MakeCorrespondences(input, SeedFor(seed, 1));
  const PointPairs& pairs = all.pairs;
  const auto needed = static_cast<std::size_t>(std::max(options.min_inliers, EssentialProblem::kSampleSize + 1));
  if (pairs.Size() < needed) return Rejected(geometry, RejectionReason::kTooFewMatches);

  const RobustOptions loop = LoopOptions(options, context);
  bool any_model = false;
  std::optional<Epipolar> model = EstimateEssential(pairs, loop, input.camera_second, SeedFor(seed, 2), any_model);
  const bool guessed = input.camera_first.source == CalibrationSource::kGuessed ||
                       input.camera_second.source == CalibrationSource::kGuessed;
  if (guessed && pairs.Size() > static_cast<std::size_t>(FundamentalProblem::kSampleSize)) {
    constexpr double kMoreSupport = 1.1;  // two more unknowns always explain a little more
    auto fundamental = EstimateFundamental(pairs, loop, input.camera_second, SeedFor(seed, 3));
    if (fundamental && (!model || static_cast<double>(fundamental->inliers.size()) >
                                      kMoreSupport * static_cast<double>(model->inliers.size()))) {
      if (fundamental->inliers.size() < needed) return Rejected(geometry, RejectionReason::kTooFewInliers);
      const PlaneFit plane =
          FitPlane(pairs.Subset(fundamental->inliers), fundamental->threshold_px, loop, SeedFor(seed, 4));
      geometry.homography_ratio = plane.share;
      const bool planar = plane.share > options.planar_ratio;
      geometry.model = planar ? TwoViewModel::kHomography : TwoViewModel::kFundamental;
      geometry.matrix =
          planar ? HomographyInPixels(plane.matrix, input) : FundamentalInPixels(fundamental->matrix, input);
      geometry.inliers = MatchesOf(all, fundamental->inliers, input.matches);
      return geometry;
    }
  }
  if (!model) return Rejected(geometry, any_model ? RejectionReason::kTooFewInliers : RejectionReason::kNoModel);
  if (model->inliers.size() < needed) return Rejected(geometry, RejectionReason::kTooFewInliers);
  DescribeCalibrated(input, options, pairs, loop, SeedFor(seed, 4), *model, geometry);
  if (model->inliers.size() < needed) return Rejected(geometry, RejectionReason::kTooFewInliers);
  geometry.inliers = MatchesOf(all, model->inliers, input.matches);
  return geometry;
}

}  // namespace rilievo::verification
