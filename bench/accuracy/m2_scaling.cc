// Pairs of a block, matched and verified, by one thread and by two at once.
#include "base/error.h"
#include "bench/accuracy/features_detectors.h"
#include "bench/accuracy/m2_eval.h"
#include "bench/accuracy/scaling.h"
#include "stages/matching/matching.h"
#include "stages/verification/verification.h"

namespace rilievo::bench {

Json MeasurePairScaling(const std::vector<std::string>& image_paths) {
  SerialRunContext detecting;
  std::vector<ImageFeatures> features;
  Camera camera;
  for (const std::string& path : image_paths) {
    const GreyImage image = LoadGrey(path);
    features.push_back(DetectOurs(image, {}, detecting));
    camera.width_px = image.width_px;
    camera.height_px = image.height_px;
  }
  camera.model.fx = camera.model.fy = 0.9 * camera.width_px;
  camera.model.cx = 0.5 * camera.width_px;
  camera.model.cy = 0.5 * camera.height_px;
  std::vector<std::size_t> inliers(2);
  const auto match_all = [&](int thread) {
    SerialRunContext context;
    std::size_t count = 0;
    for (std::uint32_t i = 0; i < features.size(); ++i) {
      for (std::uint32_t j = i + 1; j < features.size(); ++j) {
        const auto matches = matching::Run(features[i].descriptors, features[j].descriptors, {}, context);
        count += verification::Run(
                     {{ImageId(i), ImageId(j)}, camera, camera, features[i].keypoints, features[j].keypoints, matches},
                     {}, context)
                     .inliers.size();
      }
    }
    inliers[static_cast<std::size_t>(thread)] = count;
  };
  Json result = ScalingBesideFma(match_all, 5);
  if (inliers[0] == 0 || inliers[0] != inliers[1])
    throw Error(ErrorCode::kInternal, "", "the threads found no inliers, or not the same number");
  result["pairs"] = features.size() * (features.size() - 1) / 2;
  result["inliers"] = inliers[0];
  return result;
}

}  // namespace rilievo::bench
