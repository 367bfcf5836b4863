// An oriented component of the block: exterior orientations, object points and their rays.
#pragma once

#include <Eigen/Core>
#include <map>
#include <string>
#include <vector>

#include "base/ids.h"
#include "block/features.h"
#include "block/track.h"
#include "geometry/rigid3.h"

namespace rilievo {

/// A ray: the measured image coordinates of an object point in one image.
struct Observation {
  FeatureRef feature;
  Eigen::Vector2d measured_px = Eigen::Vector2d::Zero();
  Eigen::Vector2d residual_px = Eigen::Vector2d::Zero();  ///< projected minus measured, of the last adjustment
};

struct Point {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< world frame, model units
  Rgb color{128, 128, 128};
  std::vector<Observation> observations;  ///< sorted by image, one an image
};

/// World frame and scale are free (no control): the datum is fixed by the mapper and stated in the report.
struct Model {
  std::map<ImageId, Rigid3> cam_from_world;
  std::vector<Point> points;
  double sigma0_px = 0;  ///< sqrt(v'v / redundancy) of the last least-squares adjustment
  long redundancy = 0;   ///< observations - unknowns + datum defect
};

/// Why an image is in no model, for the report.
struct UnorientedImage {
  ImageId image;
  std::string reason;  ///< one line with what to do
};

}  // namespace rilievo
