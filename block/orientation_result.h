// The result of an orientation run: models, what was left out and why, and what each image and pair contributed.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "block/model.h"
#include "block/pair.h"
#include "block/tie_summary.h"

namespace rilievo {

struct ImageSummary {
  std::uint32_t features = 0;
  std::string quarantine;  ///< reason when the image could not be decoded, else empty
  double coverage = 0;     ///< share of the cells of a CoverageGrid that hold a feature
};

struct PairSummary {
  ImagePair pair;
  TwoViewModel model = TwoViewModel::kRejected;
  RejectionReason reason = RejectionReason::kNone;
  std::uint32_t matches = 0, inliers = 0;
  double median_angle_rad = 0, homography_ratio = 0;
};

struct OrientationResult {
  std::vector<Model> models;                ///< largest first
  std::vector<UnorientedImage> unoriented;  ///< sorted by image; quarantined images are not among them
  std::vector<ImageSummary> images;         ///< by image id
  std::vector<PairSummary> pairs;           ///< sorted by pair
  std::vector<std::string> warnings = {};   ///< what speaks against the models, one line each
  TieSummary ties = {};
};

}  // namespace rilievo
