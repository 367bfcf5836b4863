// Words for images that stay outside.
#include "stages/mapping/reasons.h"

#include <cstdio>
#include <optional>
#include <string>

#include "base/units.h"

namespace rilievo::mapping {
namespace {

struct PairSummary {
  std::size_t verified = 0;        ///< pairs
  std::size_t best_inliers = 0;    ///< of a verified pair
  std::uint32_t best_matches = 0;  ///< of any pair, before verification
  std::optional<ImageId> partner;  ///< of the best pair
  double widest_angle_deg = 0;
};

PairSummary Summarise(ImageId image, std::span<const TwoViewGeometry> pairs) {
  PairSummary summary;
  for (const TwoViewGeometry& g : pairs) {
    if (g.pair.first != image && g.pair.second != image) continue;
    const ImageId other = g.pair.first == image ? g.pair.second : g.pair.first;
    if (g.IsVerified()) {
      ++summary.verified;
      if (g.inliers.size() > summary.best_inliers) summary.best_inliers = g.inliers.size(), summary.partner = other;
      summary.widest_angle_deg = std::max(summary.widest_angle_deg, RadToDeg(g.median_angle_rad));
    } else if (g.matches > summary.best_matches) {
      summary.best_matches = g.matches;
      if (summary.verified == 0) summary.partner = other;
    }
  }
  return summary;
}

std::string Reason(const Input& input, const PairSummary& s) {
  const std::string partner = s.partner ? input.block.image(*s.partner).name : "";
  if (input.block.images.size() < 2) return "the only image: take at least two from different places";
  if (s.verified == 0 && s.best_matches == 0)
    return "no matches with other images: take images that overlap by 60 % or more, of a textured object";
  if (s.verified == 0)
    return "too few verified matches with other images (best: " + std::to_string(s.best_matches) + " unverified with " +
           partner + "): take images with more overlap";
  if (s.widest_angle_deg < 0.5) {
    char angle[32];
    std::snprintf(angle, sizeof angle, "%.2f", s.widest_angle_deg);
    return "no image pair with enough parallax (widest intersection angle " + std::string(angle) + " deg, with " +
           partner + "): take images from different places";
  }
  return "its points do not agree with the oriented images (best: " + std::to_string(s.best_inliers) +
         " verified matches with " + partner + "): take images between this one and its neighbours";
}

}  // namespace

std::vector<UnorientedImage> UnorientedImages(const Input& input, std::span<const TwoViewGeometry> pairs,
                                              std::span<const Model> models) {
  std::vector<UnorientedImage> unoriented;
  for (const Image& image : input.block.images) {
    bool oriented = false;
    for (const Model& model : models) oriented |= model.cam_from_world.contains(image.id);
    if (!oriented) unoriented.push_back({image.id, Reason(input, Summarise(image.id, pairs))});
  }
  return unoriented;
}

}  // namespace rilievo::mapping
