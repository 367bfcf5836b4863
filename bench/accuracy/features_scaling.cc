// Throughput of two threads over one's, beside a loop of multiply-adds on registers in the same run.
#include <algorithm>
#include <cstdint>

#include "base/error.h"
#include "bench/accuracy/features_detectors.h"
#include "bench/accuracy/features_eval.h"
#include "bench/accuracy/features_threads.h"
#include "bench/accuracy/scaling.h"

namespace rilievo::bench {
Json MeasureScaling(const std::vector<std::string>& image_paths, int rounds) {
  if (image_paths.empty()) throw Error(ErrorCode::kUsage, "scaling", "needs images");
  std::vector<GreyImage> images;
  for (const std::string& path : image_paths) images.push_back(LoadGrey(path));
  const features::Options options = AllFeatures();
  std::vector<std::size_t> features(2);
  const auto detect_all = [&](int thread) {
    SerialRunContext context;
    std::size_t count = 0;
    for (const GreyImage& image : images) count += DetectOurs(image, options, context).keypoints.size();
    features[static_cast<std::size_t>(thread)] = count;
  };
  Json result = ScalingBesideFma(detect_all, rounds);
  if (features[0] == 0 || features[0] != features[1])
    throw Error(ErrorCode::kInternal, "", "the threads found no features, or not the same number");
  result["images"] = images.size();
  result["features"] = features[0];
  return result;
}

}  // namespace rilievo::bench
