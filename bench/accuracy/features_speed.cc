// CPU seconds of the detectors on one image, one thread, measured in turns.
#include <malloc.h>

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <optional>

#include "base/error.h"
#include "bench/accuracy/features_clock.h"
#include "bench/accuracy/features_detectors.h"
#include "bench/accuracy/features_eval.h"

namespace rilievo::bench {
namespace {

/// One of the things that take turns.
struct Contender {
  std::string name;
  std::function<std::size_t()> work;  ///< gives a number of features
  std::vector<double> cpu_s;
  std::size_t features = 0;
};

/// Interleaved, so that what else the machine does meets all alike. Nobody inherits the warm heap of the one before:
/// every contender pays for the pages it touches.
void TakeTurns(std::vector<Contender>& contenders, int repeats) {
  for (int i = 0; i < repeats; ++i) {
    for (Contender& c : contenders) {
      malloc_trim(0);
      c.cpu_s.push_back(TimeOf([&] { c.features = c.work(); }).cpu_s);
    }
  }
}

Json Entry(const Contender& c, double megapixels) {
  const double least = *std::min_element(c.cpu_s.begin(), c.cpu_s.end());
  return {{"cpu_s", least},
          {"cpu_s_per_mpx", least / megapixels},
          {"features", c.features},
          {"slowest_over_fastest", *std::max_element(c.cpu_s.begin(), c.cpu_s.end()) / least}};
}

}  // namespace

Json MeasureSpeed(const std::string& image_path, int repeats) {
  SerialRunContext context;
  const double decode_s = TimeOf([&] { LoadGrey(image_path); }).cpu_s;
  const GreyImage image = LoadGrey(image_path);
  const features::Options options = AllFeatures();
  const std::size_t our_count = DetectOurs(image, options, context).keypoints.size();
  if (our_count == 0) throw Error(ErrorCode::kInternal, image_path, "no features to compare");
  const PeerOptions same{.contrast_threshold = options.contrast_threshold, .edge_threshold = options.edge_threshold};
  const PeerOptions peer = PeerWithAtMost(image, same, our_count);

  std::vector<Contender> contenders;
  const auto add = [&](const char* name, std::function<std::size_t()> work) {
    contenders.push_back({.name = name, .work = std::move(work), .cpu_s = {}, .features = 0});
  };
  add("ours", [&] { return DetectOurs(image, options, context).keypoints.size(); });
  add("opencv", [&] { return PeerDetectAndCompute(image, peer); });
  add("opencv_detect", [&] { return PeerDetect(image, peer); });
  if (DetectOursExtremaOnly(image, options, context)) {
    add("ours_extrema", [&] { return DetectOursExtremaOnly(image, options, context).value(); });
  }
  features::Options gloh = options, pca_sift = options;
  gloh.detector = "gloh";
  pca_sift.detector = "pca-sift";
  add("ours_gloh", [&] { return DetectOurs(image, gloh, context).keypoints.size(); });
  add("ours_pca_sift", [&] { return DetectOurs(image, pca_sift, context).keypoints.size(); });
  const std::optional<SurfChoice> surf = ChooseSurf128(image, our_count, context);
  if (surf) add("ours_surf128", [&] { return DetectOurs(image, surf->options, context).keypoints.size(); });
  TakeTurns(contenders, repeats);

  const double megapixels = 1e-6 * image.width_px * image.height_px;
  const char* kernels = std::getenv("RILIEVO_KERNELS");
  Json result{{"image", image_path},
              {"megapixels", megapixels},
              {"kernels", kernels ? kernels : ""},
              {"repeats", repeats},
              {"decode_cpu_s", decode_s},
              {"contrast_threshold", {{"ours", options.contrast_threshold}, {"opencv", peer.contrast_threshold}}}};
  for (const char* name :
       {"ours", "opencv", "opencv_detect", "ours_extrema", "ours_gloh", "ours_pca_sift", "ours_surf128"}) {
    result[name] = nullptr;
  }
  for (const Contender& c : contenders) result[c.name] = Entry(c, megapixels);
  return result;
}

}  // namespace rilievo::bench
