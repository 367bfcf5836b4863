// What is known of two images together: matches and the verified two-view geometry.
#pragma once

#include <Eigen/Core>
#include <compare>
#include <cstdint>
#include <string>
#include <vector>

#include "base/ids.h"
#include "geometry/rigid3.h"

namespace rilievo {

/// Unordered pair with first < second.
struct ImagePair {
  ImageId first, second;
  friend auto operator<=>(const ImagePair&, const ImagePair&) = default;
};

/// Indices of the features matched in the first and second image.
struct Match {
  std::uint32_t first = 0, second = 0;
  friend auto operator<=>(const Match&, const Match&) = default;
};

enum class TwoViewModel : std::uint8_t { kRejected, kEssential, kFundamental, kHomography };
enum class RejectionReason : std::uint8_t { kNone, kTooFewMatches, kTooFewInliers, kNoModel };

/// The verified geometry of a pair. `second_from_first` has |translation| = 1 (or 0 for pure rotation) and is valid for
/// kEssential (and kHomography of calibrated pairs). Homography: planar scene or rotation only.
struct TwoViewGeometry {
  ImagePair pair;
  TwoViewModel model = TwoViewModel::kRejected;
  RejectionReason reason = RejectionReason::kNone;
  Rigid3 second_from_first;
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();  ///< E (normalised coordinates) where a pose with translation is
                                                     ///< given, else F or H (pixels)
  std::vector<Match> inliers;                        ///< sorted by first
  std::uint32_t matches = 0;                         ///< matches before verification
  double median_angle_rad = 0;                       ///< median intersection angle of the inliers
  double homography_ratio = 0;                       ///< H inliers / E inliers
  bool IsVerified() const { return model != TwoViewModel::kRejected; }
};

std::string ToText(RejectionReason reason);

}  // namespace rilievo
