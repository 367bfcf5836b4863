// Simulated pairs with known inliers, and how good an answer about one is.
#pragma once

#include <algorithm>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <vector>

#include "block/camera.h"
#include "block/features.h"
#include "block/pair.h"
#include "tests/support/two_view_scenes.h"

namespace rilievo::bench {

using Json = nlohmann::ordered_json;

/// What a row of the table is about; 1000 matches, 3072 x 2048 px, focal length 2760 px.
struct VerificationCase {
  bool planar = false;
  double outlier_share = 0.6;
  double noise_px = 0.5;
  double confidence = 0.999;
  /// Of all methods: 2 px, or what 99 % of the right matches keep.
  double Threshold_px() const { return std::max(2.0, 2.5 * noise_px); }
};

/// A pair as verification takes it; match i is right for i < scene.inliers. Its own camera has no distortion, which the
/// peer does not undo.
struct SimulatedPair {
  TwoViewScene scene;
  Camera camera;
  std::vector<Keypoint> first, second;
  std::vector<Match> matches;
};
SimulatedPair MakeSimulatedPair(const VerificationCase& c, std::uint64_t seed);

/// One method's answer about one pair.
struct Answer {
  double cpu_s = 0;
  bool found = false;
  std::vector<std::uint32_t> inliers;
  Rigid3 second_from_first;
};
/// The stage's whole verification: E, H beside it, pose, median angle.
Answer VerifyOurs(const SimulatedPair& pair, const VerificationCase& c, std::uint64_t seed);
/// E alone, MAPSAC, with the closing refinement and the pose, of prepared coordinates.
Answer EstimateOurs(const SimulatedPair& pair, const VerificationCase& c, std::uint64_t seed);
/// cv::findEssentialMat with as many trials as ours may draw (its default of 1000 does not reach the confidence where
/// 70 % are wrong); the time of the pose (cv::recoverPose) does not count.
enum class Peer { kRansac, kUsacMagsac, kRansacDefaultTrials, kUsacMagsacDefaultTrials };
Answer EstimatePeer(const SimulatedPair& pair, const VerificationCase& c, Peer peer);

}  // namespace rilievo::bench
