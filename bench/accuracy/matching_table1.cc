// One row of the paper's Table I: trees beside m2 on two rendered images of that size and number of features.
#include "bench/accuracy/features_detectors.h"
#include "bench/accuracy/matching_eval.h"
#include "simulation/renderer.h"

namespace rilievo::bench {
namespace {

/// Two views of a relief, as far apart as neighbours of a walk along a wall.
simulation::Renderer RendererOf(int width_px, int height_px) {
  simulation::SceneOptions options;
  options.images = 2;
  options.width_px = width_px;
  options.height_px = height_px;
  options.angle_step_deg = 12;
  return simulation::Renderer(simulation::MakeScene(options));
}

/// The contrast threshold is lowered until there are enough.
ImageFeatures StrongestOf(const simulation::Renderer& renderer, std::size_t image, std::size_t count) {
  const GreyImage pixels = renderer.RenderGrey(image);
  features::Options options = AllFeatures();
  SerialRunContext context;
  ImageFeatures found = DetectOurs(pixels, options, context);
  while (found.keypoints.size() < count && options.contrast_threshold > 0.001) {
    options.contrast_threshold *= 0.5;
    options.edge_threshold = 10;
    found = DetectOurs(pixels, options, context);
  }
  return Strongest(found, count);
}

}  // namespace

Json MeasureTableRow(int width_px, int height_px, std::size_t features_a, std::size_t features_b, int checks,
                     bool exact) {
  const simulation::Renderer renderer = RendererOf(width_px, height_px);
  const auto a = StrongestOf(renderer, 0, features_a).descriptors, b = StrongestOf(renderer, 1, features_b).descriptors;
  const auto timed = [&](const char* matcher, int kd_checks) {
    return MatchTimed(a, b, {.matcher = matcher, .kd_checks = kd_checks});
  };
  const Timed m2 = timed("m2", checks);
  Json result = {{"features_a", a.size()},
                 {"features_b", b.size()},
                 {"m2", BesideReference(m2, m2)},
                 {"kd_tree", BesideReference(timed("kd-tree", checks), m2)},
                 {"auto", BesideReference(timed("auto", checks), m2)}};
  if (exact) result["kd_tree_exact"] = BesideReference(timed("kd-tree", 0), m2);
  return result;
}

}  // namespace rilievo::bench
