// Simulated pairs and the methods that are asked about them.
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <optional>

#include "base/run_context.h"
#include "bench/accuracy/features_clock.h"
#include "bench/accuracy/verification_eval.h"
#include "geometry/epipolar.h"
#include "geometry/essential_refinement.h"
#include "geometry/robust/estimate.h"
#include "geometry/robust/two_view_problems.h"
#include "stages/verification/correspondences.h"
#include "stages/verification/verification.h"

namespace rilievo::bench {
namespace {

constexpr std::size_t kMatches = 1000;
constexpr int kMaxTrials = 10000;

verification::Options OptionsFor(const VerificationCase& c) {
  verification::Options options;
  options.threshold_px = c.Threshold_px();
  options.confidence = c.confidence;
  options.max_trials = kMaxTrials;
  return options;
}

verification::Input InputOf(const SimulatedPair& pair) {
  return {{ImageId(0), ImageId(1)}, pair.camera, pair.camera, pair.first, pair.second, pair.matches};
}

}  // namespace

SimulatedPair MakeSimulatedPair(const VerificationCase& c, std::uint64_t seed) {
  Rng rng(seed);
  SimulatedPair pair;
  pair.scene = MakeTwoViewScene(rng, {.points = kMatches, .planar = c.planar, .outlier_share = c.outlier_share});
  pair.camera.id = CameraId(0);
  pair.camera.model.fx = pair.camera.model.fy = 2760;
  pair.camera.model.cx = 1536;
  pair.camera.model.cy = 1024;
  pair.camera.width_px = 3072;
  pair.camera.height_px = 2048;
  const auto pixel = [&](const Eigen::Vector2d& ideal) {
    Keypoint keypoint;
    keypoint.x_px = static_cast<float>(2760 * ideal.x() + 1536 + c.noise_px * rng.Normal());
    keypoint.y_px = static_cast<float>(2760 * ideal.y() + 1024 + c.noise_px * rng.Normal());
    return keypoint;
  };
  for (std::uint32_t i = 0; i < pair.scene.first.size(); ++i) {
    pair.first.push_back(pixel(pair.scene.first[i]));
    pair.second.push_back(pixel(pair.scene.second[i]));
    pair.matches.push_back({i, i});
  }
  return pair;
}

Answer VerifyOurs(const SimulatedPair& pair, const VerificationCase& c, std::uint64_t seed) {
  const verification::Options options = OptionsFor(c);
  SerialRunContext context(seed);
  Answer answer;
  TwoViewGeometry geometry;
  answer.cpu_s = TimeOf([&] { geometry = verification::Run(InputOf(pair), options, context); }).cpu_s;
  answer.found = geometry.IsVerified();
  for (const Match& match : geometry.inliers) answer.inliers.push_back(match.first);
  answer.second_from_first = geometry.second_from_first;
  return answer;
}

Answer EstimateOurs(const SimulatedPair& pair, const VerificationCase& c, std::uint64_t seed) {
  const verification::Correspondences all = verification::MakeCorrespondences(InputOf(pair), SeedFor(seed, 1));
  const RobustOptions options{.threshold = c.Threshold_px(), .confidence = c.confidence, .max_trials = kMaxTrials};
  Answer answer;
  answer.cpu_s = TimeOf([&] {
                   const EssentialProblem problem(all.pairs, EpipolarResidual::kSampson);
                   const auto estimate = EstimateRobustly(problem, options, seed);
                   answer.found = estimate.has_value();
                   if (!estimate) return;
                   const PointPairs inliers = all.pairs.Subset(estimate->inliers);
                   const auto refined =
                       RefineEssential(all.pairs.Arrays(estimate->inliers), all.pairs.Variances(), estimate->model);
                   const Eigen::Matrix3d& model = refined ? *refined : estimate->model;
                   answer.second_from_first = SelectPose(model, inliers.First(), inliers.Second()).second_from_first;
                   for (const auto i : estimate->inliers)
                     answer.inliers.push_back(pair.matches[all.MatchesOf(i)[0]].first);
                 }).cpu_s;
  return answer;
}

Answer EstimatePeer(const SimulatedPair& pair, const VerificationCase& c, Peer peer) {
  std::vector<cv::Point2d> first, second;
  for (std::size_t i = 0; i < pair.first.size(); ++i) {
    first.emplace_back(pair.first[i].x_px, pair.first[i].y_px);
    second.emplace_back(pair.second[i].x_px, pair.second[i].y_px);
  }
  const CameraModel& model = pair.camera.model;
  const cv::Mat k = (cv::Mat_<double>(3, 3) << model.fx, 0, model.cx, 0, model.fy, model.cy, 0, 0, 1);
  const bool ransac = peer == Peer::kRansac || peer == Peer::kRansacDefaultTrials;
  const int trials = peer == Peer::kRansac || peer == Peer::kUsacMagsac ? kMaxTrials : 1000;
  cv::Mat essential, mask;
  Answer answer;
  answer.cpu_s = TimeOf([&] {
                   essential = cv::findEssentialMat(first, second, k, ransac ? cv::RANSAC : cv::USAC_MAGSAC,
                                                    c.confidence, c.Threshold_px(), trials, mask);
                 }).cpu_s;
  answer.found = essential.rows == 3 && essential.cols == 3;
  if (!answer.found) return answer;
  for (std::uint32_t i = 0; i < first.size(); ++i) {
    if (mask.at<std::uint8_t>(static_cast<int>(i)) != 0) answer.inliers.push_back(i);
  }
  cv::Mat rotation, translation;
  cv::recoverPose(essential, first, second, k, rotation, translation, mask);
  Eigen::Matrix3d r;
  Eigen::Vector3d t;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) r(i, j) = rotation.at<double>(i, j);
    t[i] = translation.at<double>(i);
  }
  answer.second_from_first = Rigid3(r, t);
  return answer;
}

}  // namespace rilievo::bench
