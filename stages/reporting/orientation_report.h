// The orientation report: what was oriented, how well, and what was not and why. Text for people, JSON for programs.
#pragma once

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "block/block.h"
#include "block/orientation_result.h"

namespace rilievo::reporting {

/// One oriented image of a component. Residuals are projected minus measured, in pixels of the stored image.
struct ImageReport {
  ImageId image;
  std::size_t rays = 0;
  double rms_x_px = 0, rms_y_px = 0, max_residual_px = 0;
  double coverage = 0;  ///< share of the cells of an 8 x 8 grid over the image that hold a ray
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
};

/// One component of the block.
struct ModelReport {
  std::vector<ImageReport> images;  ///< by image id
  std::size_t points = 0, rays = 0;
  double mean_multiplicity = 0;
  std::array<std::size_t, 8> multiplicity{};  ///< points with 2, 3, ..., 8, 9+ rays
  double sigma0_px = 0, rms_px = 0, max_residual_px = 0;
  long redundancy = 0;
  double min_angle_deg = 0, mean_angle_deg = 0, max_angle_deg = 0;  ///< largest intersection angle of each point
};

struct Report {
  std::vector<ModelReport> models;
  std::size_t images = 0;  ///< usable ones: without the quarantined
  std::size_t oriented = 0, features = 0;
  std::vector<QuarantinedImage> quarantined;  ///< found unusable by header or by decoding
  std::size_t pairs = 0, pairs_verified = 0, matches = 0, inliers = 0;
};

/// Pure; cost O(rays of all models x mean multiplicity).
Report Summarize(const Block& block, const OrientationResult& result);

/// `warnings` are those of the inputs; what speaks against the models comes from the result.
std::string ToText(const Report& report, const Block& block, const OrientationResult& result,
                   const std::vector<std::string>& warnings);
nlohmann::json ToJson(const Report& report, const Block& block, const OrientationResult& result,
                      const std::vector<std::string>& warnings);

}  // namespace rilievo::reporting
