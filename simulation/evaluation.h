// Compares an oriented model with the truth of the scene it was made from.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>

#include "block/model.h"
#include "geometry/similarity3.h"
#include "simulation/renderer.h"

namespace rilievo::simulation {

/// Of lengths or angles; all zero when `count` is.
struct ErrorStatistics {
  std::size_t count = 0;
  double mean = 0, median = 0, rms = 0, p95 = 0, max = 0;
};

struct ModelErrors {
  Similarity3 truth_from_model;   ///< least squares over the projection centres
  ErrorStatistics centers_m;      ///< |aligned centre - true centre|
  ErrorStatistics rotations_deg;  ///< angle between aligned and true attitude
  double object_distance_m = 0;   ///< mean distance from the true centres to what the image's middle shows
  double center_relative = 0;     ///< 1 : N, N = object distance / mean centre error (infinite for no error)
  /// Every object point against the true point of its rays: the median, coordinate by coordinate, of where the true
  /// poses' rays through the measured image points meet the surface. Contains the measuring error of those.
  ErrorStatistics points_m;
  /// Every object point against the nearest point of the true surface, same alignment; none is left out.
  ErrorStatistics surface_m;
  /// As points_m after a similarity fitted to the points themselves (trimmed at three medians): what remains when the
  /// datum is no matter, e.g. in a single strip whose centres hardly fix the rotation about its line.
  ErrorStatistics points_own_datum_m;
  std::size_t points_without_truth = 0;  ///< none of whose measured rays meets the surface
};

/// `image_names` gives the scene's name of each image of the model; images that the scene does not have are an Error
/// (kInvalidInput). None with fewer than three images or coinciding centres.
std::optional<ModelErrors> EvaluateModel(const Model& model, const std::map<ImageId, std::string>& image_names,
                                         const Renderer& renderer);

}  // namespace rilievo::simulation
