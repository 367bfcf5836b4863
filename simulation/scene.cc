// The options of a scene and the layout of its camera network.
#include "simulation/scene.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "base/rng.h"
#include "base/units.h"

namespace rilievo::simulation {
namespace {

/// Neighbours all around a closed object must see the same parts of it under angles that matching survives.
constexpr double kLargestRingStep_deg = 15;

/// A camera to be: projection centre, the point it looks at and its roll about the axis of view.
struct View {
  Eigen::Vector3d center_m, target_m;
  double roll_rad = 0;
};

/// x right, y down, z forward; `up` is +y of the world.
Rigid3 LookAt(const View& view) {
  const Eigen::Vector3d z = (view.target_m - view.center_m).normalized();
  const Eigen::Vector3d x = z.cross(Eigen::Vector3d::UnitY()).normalized();
  Eigen::Matrix3d world_from_cam;
  world_from_cam << x, z.cross(x), z;
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(view.roll_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  Rigid3 pose;
  pose.rotation = Eigen::Quaterniond(Eigen::Matrix3d(turn * world_from_cam.transpose())).normalized();
  pose.translation = -(pose.rotation * view.center_m);
  return pose;
}

/// Direction of azimuth (about y, 0 = +z) and elevation.
Eigen::Vector3d Direction(double azimuth_rad, double elevation_rad) {
  return {std::sin(azimuth_rad) * std::cos(elevation_rad), std::sin(elevation_rad),
          std::cos(azimuth_rad) * std::cos(elevation_rad)};
}

View Convergent(const SceneOptions& o, double azimuth_deg, double elevation_deg, Rng& rng) {
  const double jitter_m = 0.02 * o.distance_m;
  View view;
  view.center_m = o.distance_m * rng.Uniform(0.97, 1.03) * Direction(DegToRad(azimuth_deg), DegToRad(elevation_deg));
  view.target_m = {rng.Uniform(-jitter_m, jitter_m), rng.Uniform(-jitter_m, jitter_m), 0};
  view.roll_rad = DegToRad(rng.Uniform(-3, 3));
  return view;
}

/// Neighbours `step` apart, elevations in a wave of three so that the projection centres are not collinear. A relief is
/// seen from at most 35 degrees to either side.
View ArcView(const SceneOptions& o, int i, Rng& rng) {
  const double limit_deg = o.surface == "relief" ? 70 : 180;
  const double wanted_deg = o.angle_step_deg > 0 ? o.angle_step_deg : (o.surface == "relief" ? 5 : 8);
  const double step_deg = o.images > 1 ? std::min(wanted_deg, limit_deg / (o.images - 1)) : 0;
  constexpr std::array<double, 3> kElevation_deg{-5, 3, 8};
  return Convergent(o, step_deg * (i - 0.5 * (o.images - 1)), kElevation_deg[i % 3] + rng.Uniform(-1, 1), rng);
}

/// Closed objects: all around. A relief: on a cone of 20 degrees about its normal.
View RingView(const SceneOptions& o, int i, Rng& rng) {
  const double turn_deg = 360.0 * i / o.images;
  if (o.surface != "relief") return Convergent(o, turn_deg, (i % 2 == 0 ? -6 : 10) + rng.Uniform(-1, 1), rng);
  const double phi = DegToRad(turn_deg), cone_deg = 20;
  return Convergent(o, cone_deg * std::cos(phi), cone_deg * std::sin(phi), rng);
}

View RandomView(const SceneOptions& o, Rng& rng) {
  SceneOptions moved = o;
  moved.distance_m *= rng.Uniform(0.88, 1.12);
  if (o.surface != "relief") return Convergent(moved, rng.Uniform(0, 360), rng.Uniform(-35, 35), rng);
  const double phi = rng.Uniform(0, 2 * std::numbers::pi), cone_deg = 28 * std::sqrt(rng.Uniform());
  return Convergent(moved, cone_deg * std::cos(phi), cone_deg * std::sin(phi), rng);
}

/// Parallel views, 78 % forward and 65 % side overlap unless the intersection angle is given.
View StripView(const SceneOptions& o, double focal_px, int i, Rng& rng) {
  const int per_strip = (o.images + o.strips - 1) / o.strips, row = i / per_strip, column = i % per_strip;
  const double base_m = o.angle_step_deg > 0 ? o.distance_m * std::tan(DegToRad(o.angle_step_deg))
                                             : 0.22 * o.distance_m * o.width_px / focal_px;
  const double side_m = 0.35 * o.distance_m * o.height_px / focal_px, jitter_m = 0.05 * base_m;
  const int forward = row % 2 == 0 ? column : per_strip - 1 - column;  // flown to and fro
  const double reach_m = o.surface == "relief" ? 0 : 0.5 * o.object_size_m;
  View view;
  view.center_m = {(forward - 0.5 * (per_strip - 1)) * base_m + rng.Uniform(-jitter_m, jitter_m),
                   (0.5 * (o.strips - 1) - row) * side_m + rng.Uniform(-2, 2) * jitter_m,
                   reach_m + o.distance_m * rng.Uniform(0.96, 1.04)};
  const double tilt_m = 0.05 * o.distance_m;
  view.target_m = {view.center_m.x() + rng.Uniform(-tilt_m, tilt_m), view.center_m.y() + rng.Uniform(-tilt_m, tilt_m),
                   0};
  view.roll_rad = DegToRad(rng.Uniform(-3, 3));
  return view;
}

View MakeView(const SceneOptions& o, double focal_px, int i) {
  Rng rng(SeedFor(static_cast<std::uint64_t>(o.seed), 0x76696577, i));
  if (o.network == "arc") return ArcView(o, i, rng);
  if (o.network == "ring") return RingView(o, i, rng);
  if (o.network == "strip") return StripView(o, focal_px, i, rng);
  return RandomView(o, rng);
}

Camera MakeCamera(const SceneOptions& o) {
  Camera camera;
  camera.id = CameraId(0);
  camera.width_px = o.width_px;
  camera.height_px = o.height_px;
  camera.source = CalibrationSource::kGiven;
  camera.label = "simulated";
  CameraModel& m = camera.model;
  m.fx = m.fy = o.focal_px > 0 ? o.focal_px : 1.1 * o.width_px;
  m.cx = 0.5 * o.width_px;
  m.cy = 0.5 * o.height_px;
  if (o.distortion) {
    m.kind = CameraModelKind::kOpenCv;
    m.cx += 0.003 * o.width_px;
    m.cy -= 0.004 * o.height_px;
    m.k1 = -0.06, m.k2 = 0.03, m.p1 = 2e-4, m.p2 = -1.5e-4;
  }
  return camera;
}

/// The part of z = 0 that any image sees, with a margin for the relief's height: each image is full of the object.
Eigen::Vector4d PanelSeen(const Scene& scene) {
  const SceneOptions& o = scene.options;
  const double half_m = 0.5 * o.object_size_m, floor_m = -0.12 * o.object_size_m;
  Eigen::Vector4d panel_m(-half_m, half_m, -half_m, half_m);
  for (const Rigid3& pose : scene.cam_from_world) {
    const Eigen::Vector3d center = pose.Center();
    for (int k = 0; k < 8; ++k) {  // corners and the middles of the sides
      constexpr std::array<std::array<double, 2>, 8> kAt{
          {{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0.5, 0}, {1, 0.5}, {0.5, 1}, {0, 0.5}}};
      const auto ray = scene.camera.model.Normalize({kAt[k][0] * o.width_px, kAt[k][1] * o.height_px});
      if (!ray)
        throw Error(ErrorCode::kUsage, "--focal-px", "the distortion cannot be inverted at the image border",
                    "use a longer focal length");
      const Eigen::Vector3d direction = pose.rotation.conjugate() * ray->homogeneous();
      const double reach = direction.z() < -0.05 ? (floor_m - center.z()) / direction.z() : 20 * o.distance_m;
      const Eigen::Vector3d seen = center + std::min(reach, 20 * o.distance_m / direction.norm()) * direction;
      panel_m[0] = std::min(panel_m[0], seen.x()), panel_m[1] = std::max(panel_m[1], seen.x());
      panel_m[2] = std::min(panel_m[2], seen.y()), panel_m[3] = std::max(panel_m[3], seen.y());
    }
  }
  const double margin_m = 0.05 * o.distance_m;
  return panel_m + Eigen::Vector4d(-margin_m, margin_m, -margin_m, margin_m);
}

void CheckCombination(const SceneOptions& o) {
  ValidateOptions(o, SceneOptionDeclarations());
  if (o.bits == "16" && o.format == "jpg")
    throw Error(ErrorCode::kUsage, "--bits", "JPEG files hold 8 bits only", "use --format tif or png for 16 bits");
  const double nearest_m = (o.surface == "relief" ? 0.3 : 0.75) * o.object_size_m;
  if (o.distance_m < nearest_m)
    throw Error(ErrorCode::kUsage, "--distance-m", "the cameras would stand inside the object",
                "use a longer distance or a smaller --object-size-m");
  if (o.strips > o.images)
    throw Error(ErrorCode::kUsage, "--strips", "there are more strips than images", "use fewer strips");
}

using O = SceneOptions;

/// The object, the camera and where it stands.
const std::vector<OptionDeclaration<O>>& LayoutDeclarations() {
  static const std::vector<OptionDeclaration<O>> kLayout{
      {.name = "surface",
       .member = &O::surface,
       .unit = "",
       .help = "object: a displaced panel, a displaced sphere or a statue-like body",
       .choices = {"relief", "sphere", "statue"}},
      {.name = "network",
       .member = &O::network,
       .unit = "",
       .help = "layout of the cameras",
       .choices = {"arc", "strip", "ring", "random"}},
      {.name = "images", .member = &O::images, .min = 1, .max = 100000, .unit = "", .help = "number of images"},
      {.name = "width-px", .member = &O::width_px, .min = 16, .max = 65000, .unit = "px", .help = "image width"},
      {.name = "height-px", .member = &O::height_px, .min = 16, .max = 65000, .unit = "px", .help = "image height"},
      {.name = "focal-px",
       .member = &O::focal_px,
       .min = 0,
       .max = 1e6,
       .unit = "px",
       .help = "principal distance; 0 = 1.1 times the width"},
      {.name = "distance-m",
       .member = &O::distance_m,
       .min = 1e-3,
       .max = 1e4,
       .unit = "m",
       .help = "distance from the cameras to the object's centre"},
      {.name = "object-size-m",
       .member = &O::object_size_m,
       .min = 1e-3,
       .max = 1e4,
       .unit = "m",
       .help = "size of the object; a relief is continued until it fills every image"},
      {.name = "angle-step-deg",
       .member = &O::angle_step_deg,
       .min = 0,
       .max = 60,
       .unit = "deg",
       .help = "intersection angle of neighbouring images in arcs and strips; 0 = the network's own"},
      {.name = "strips", .member = &O::strips, .min = 1, .max = 1000, .unit = "", .help = "rows of a strip network"},
  };
  return kLayout;
}

/// What the camera makes of the light, and the files.
const std::vector<OptionDeclaration<O>>& ImageDeclarations() {
  static const std::vector<OptionDeclaration<O>> kImage{
      {.name = "noise",
       .member = &O::noise,
       .min = 0,
       .max = 0.5,
       .unit = "",
       .help = "standard deviation of the image noise as a fraction of the full range"},
      {.name = "blur-px",
       .member = &O::blur_px,
       .min = 0,
       .max = 5,
       .unit = "px",
       .help = "sigma of the Gaussian point spread function"},
      {.name = "vignetting",
       .member = &O::vignetting,
       .min = 0,
       .max = 0.9,
       .unit = "",
       .help = "loss of light in the image corners as a fraction"},
      {.name = "exposure-spread",
       .member = &O::exposure_spread,
       .min = 0,
       .max = 0.5,
       .unit = "",
       .help = "largest difference of an image's exposure from 1"},
      {.name = "distortion",
       .member = &O::distortion,
       .unit = "",
       .help = "give the lens radial and tangential distortion"},
      {.name = "bits", .member = &O::bits, .unit = "", .help = "bits a pixel", .choices = {"8", "16"}},
      {.name = "format",
       .member = &O::format,
       .unit = "",
       .help = "format of the image files",
       .choices = {"jpg", "png", "tif"}},
      {.name = "surface-points",
       .member = &O::surface_points,
       .min = 100,
       .max = 50000000,
       .unit = "",
       .help = "vertices of the surface's mesh, about"},
      {.name = "seed",
       .member = &O::seed,
       .min = 0,
       .max = 2147483647,
       .unit = "",
       .help = "another seed is another object and another network"},
  };
  return kImage;
}

}  // namespace

std::span<const OptionDeclaration<SceneOptions>> SceneOptionDeclarations() {
  static const std::vector<OptionDeclaration<O>> kDeclarations = [] {
    std::vector<OptionDeclaration<O>> all = LayoutDeclarations();
    all.insert(all.end(), ImageDeclarations().begin(), ImageDeclarations().end());
    return all;
  }();
  return kDeclarations;
}

Scene MakeScene(const SceneOptions& options) {
  CheckCombination(options);
  Scene scene;
  scene.options = options;
  scene.camera = MakeCamera(options);
  for (int i = 0; i < options.images; ++i) {
    char name[32];
    std::snprintf(name, sizeof name, "image_%04d.%s", i + 1, options.format.c_str());
    scene.names.emplace_back(name);
    scene.cam_from_world.push_back(LookAt(MakeView(options, scene.camera.model.fx, i)));
    Rng rng(SeedFor(static_cast<std::uint64_t>(options.seed), 0x6578706f, i));
    scene.exposures.push_back(1.0 + options.exposure_spread * rng.Uniform(-1, 1));
  }
  if (options.surface == "relief") scene.panel_m = PanelSeen(scene);
  return scene;
}

std::vector<std::string> SceneWarnings(const SceneOptions& options) {
  std::vector<std::string> warnings;
  const double step_deg = 360.0 / options.images;
  if (options.network == "ring" && options.surface != "relief" && step_deg > kLargestRingStep_deg) {
    char text[160];
    std::snprintf(text, sizeof text,
                  "--images %d puts %.0f degrees between neighbours of the ring; use %d or more images", options.images,
                  step_deg, static_cast<int>(std::ceil(360 / kLargestRingStep_deg)));
    warnings.emplace_back(text);
  }
  return warnings;
}

}  // namespace rilievo::simulation
