// What speaks against a finished orientation: verified pairs that the models contradict, weakly held images.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "block/model.h"
#include "stages/mapping/mapping.h"

namespace rilievo::mapping {

/// How many of a pair's verified matches agree with the final model of its two images.
struct PairAgreement {
  ImagePair pair;
  std::size_t agreeing = 0, verified = 0;
  double rotation_rad = 0;  ///< between the pair's own relative orientation and the model's; 0 where the pair has none
  double Share() const { return static_cast<double>(agreeing) / static_cast<double>(verified); }
};

/// Every verified pair with both images in `model`, in the order given. A match agrees when the object point that one
/// of its features has a ray of projects within max_residual_px of the other feature (both ways where both have one);
/// a match without object point when its Sampson distance to the model's epipolar geometry is within it. The points are
/// what tells images shifted by one period of a repetitive facade: along epipolar lines all periods look right. Cost
/// O(rays of the model + matches of the pairs).
std::vector<PairAgreement> Agreements(const Input& input, std::span<const TwoViewGeometry> pairs, const Model& model,
                                      double max_residual_px);

/// One line each, gravest first within its kind, at most ten of a kind: contradicted pairs, models that the verified
/// matches as a whole do not fit, images held by few rays, models that verified pairs connect but that could not be
/// joined.
std::vector<std::string> Doubts(const Input& input, std::span<const TwoViewGeometry> pairs,
                                std::span<const Model> models, double max_residual_px);

}  // namespace rilievo::mapping
