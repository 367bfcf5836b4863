// Time and accuracy of verification beside cv::findEssentialMat, on the same simulated pairs in turns: JSON on stdout.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <functional>
#include <numbers>
#include <opencv2/core.hpp>
#include <string>

#include "base/hash.h"
#include "bench/accuracy/verification_eval.h"

namespace rilievo::bench {
namespace {

struct Method {
  std::string name;
  int every = 1;  ///< the slow ones are asked about every third pair only
  std::function<Answer(const SimulatedPair&, const VerificationCase&, std::uint64_t)> run;
  std::vector<double> cpu_s = {}, recovered = {}, wrong = {}, rotation_deg = {}, translation_deg = {};
  int found = 0, right_pose = 0;
};

double Median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return 0.5 * (values[(n - 1) / 2] + values[n / 2]);
}

double Mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

void Judge(const SimulatedPair& pair, const Answer& answer, Method& method) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  const TwoViewScene& scene = pair.scene;
  const auto right =
      std::count_if(answer.inliers.begin(), answer.inliers.end(), [&](std::uint32_t i) { return i < scene.inliers; });
  method.cpu_s.push_back(answer.cpu_s);
  method.found += answer.found ? 1 : 0;
  method.recovered.push_back(static_cast<double>(right) / static_cast<double>(scene.inliers));
  method.wrong.push_back(
      answer.inliers.empty() ? 1 : 1 - static_cast<double>(right) / static_cast<double>(answer.inliers.size()));
  const Eigen::Vector3d a = answer.second_from_first.translation, b = scene.second_from_first.translation;
  method.rotation_deg.push_back(kDegrees *
                                answer.second_from_first.rotation.angularDistance(scene.second_from_first.rotation));
  method.translation_deg.push_back(kDegrees * std::atan2(a.cross(b).norm(), a.dot(b)));
  // A plane seen from one side allows a second pose, tens of degrees away.
  if (method.rotation_deg.back() < 1 && method.translation_deg.back() < 5) ++method.right_pose;
}

Json ToJson(const Method& m) {
  return {{"pairs", m.cpu_s.size()},
          {"cpu_ms", 1000 * Median(m.cpu_s)},
          {"mean_cpu_ms", 1000 * Mean(m.cpu_s)},
          {"found", m.found},
          {"recovered", Mean(m.recovered)},
          {"least_recovered", *std::min_element(m.recovered.begin(), m.recovered.end())},
          {"wrong", Mean(m.wrong)},
          {"right_pose", m.right_pose},
          {"rotation_deg", Median(m.rotation_deg)},
          {"translation_deg", Median(m.translation_deg)}};
}

std::vector<Method> Methods() {
  const auto peer = [](Peer p) {
    return
        [p](const SimulatedPair& pair, const VerificationCase& c, std::uint64_t) { return EstimatePeer(pair, c, p); };
  };
  return {{"verification", 1, VerifyOurs},
          {"essential", 1, EstimateOurs},
          {"opencv_ransac", 3, peer(Peer::kRansac)},
          {"opencv_usac_magsac", 1, peer(Peer::kUsacMagsac)},
          {"opencv_ransac_1000_trials", 3, peer(Peer::kRansacDefaultTrials)},
          {"opencv_usac_magsac_1000_trials", 1, peer(Peer::kUsacMagsacDefaultTrials)}};
}

Json Measure(int pairs) {
  Json cases = Json::array();
  for (const double confidence : {0.999, 0.9999}) {
    for (const bool planar : {false, true}) {
      for (const double outliers : {0.6, 0.7}) {
        for (const double noise_px : {0.5, 1.0}) {
          const VerificationCase c{planar, outliers, noise_px, confidence};
          std::vector<Method> methods = Methods();
          for (int i = 0; i < pairs; ++i) {
            const auto seed = static_cast<std::uint64_t>(i) + 1;
            const SimulatedPair pair = MakeSimulatedPair(c, seed);
            for (Method& m : methods) {
              if (i % m.every == 0) Judge(pair, m.run(pair, c, seed), m);
            }
          }
          Json entry{
              {"planar", planar}, {"outlier_share", outliers}, {"noise_px", noise_px}, {"confidence", confidence}};
          for (const Method& m : methods) entry[m.name] = ToJson(m);
          cases.push_back(entry);
        }
      }
    }
  }
  return {{"matches", 1000}, {"pairs", pairs}, {"cases", cases}};
}

/// A hash of each answer: kernels and machines are compared by them.
Json Answers(int pairs) {
  Json hashes = Json::array();
  for (int i = 0; i < pairs; ++i) {
    const VerificationCase c{
        .planar = i % 2 == 1, .outlier_share = 0.4 + 0.1 * (i % 4), .noise_px = i % 3 == 0 ? 1.0 : 0.5};
    const auto seed = static_cast<std::uint64_t>(i) + 1;
    const Answer answer = VerifyOurs(MakeSimulatedPair(c, seed), c, seed);
    KeyHasher hasher;
    for (const std::uint32_t inlier : answer.inliers) hasher.Add(std::uint64_t{inlier});
    for (const double value : answer.second_from_first.rotation.coeffs()) hasher.Add(value);
    for (const double value : answer.second_from_first.translation) hasher.Add(value);
    hashes.push_back(hasher.Finish().Hex());
  }
  return {{"hashes", hashes}};
}

}  // namespace
}  // namespace rilievo::bench

int main(int argc, char** argv) {
  try {
    cv::setNumThreads(1);
    const std::string command = argc == 3 ? argv[1] : "";
    const int pairs = argc == 3 ? std::stoi(argv[2]) : 0;
    if (pairs < 1 || (command != "speed" && command != "answers"))
      throw std::invalid_argument("usage: verification_eval speed|answers PAIRS");
    const auto result = command == "speed" ? rilievo::bench::Measure(pairs) : rilievo::bench::Answers(pairs);
    std::printf("%s\n", result.dump(1).c_str());
    return 0;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "verification_eval: %s\n", e.what());
    return 2;
  }
}
