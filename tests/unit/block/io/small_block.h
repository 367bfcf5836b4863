// A small oriented block with exact truth: two cameras, a few images around random points, measurements with known
// residuals.
#pragma once

#include <Eigen/Geometry>
#include <numbers>

#include "base/rng.h"
#include "block/block.h"
#include "block/model.h"

namespace rilievo {

struct SmallBlock {
  Block block;
  Model model;
};

/// `images` images on a ring around `points` points, image 1 not oriented (when there are more than 3); residuals of
/// about `noise_px`. `cameras` are assigned in turn.
inline SmallBlock MakeSmallBlock(std::vector<CameraModel> cameras, int images = 5, int points = 40,
                                 double noise_px = 0.3) {
  SmallBlock out;
  Rng rng(7);
  for (std::uint32_t c = 0; c < cameras.size(); ++c)
    out.block.cameras.push_back(
        {CameraId(c), cameras[c], 4000, 3000, CalibrationSource::kGiven, "camera " + std::to_string(c)});
  for (int i = 0; i < images; ++i) {
    Image image;
    image.id = ImageId(static_cast<std::uint32_t>(i));
    image.camera_id = CameraId(static_cast<std::uint32_t>(i) % static_cast<std::uint32_t>(cameras.size()));
    image.name = "left side/\xC3\xA4 " + std::to_string(i) + ".jpg";
    image.width_px = 4000, image.height_px = 3000, image.channels = 3;
    image.exif.model = "Simulated";
    image.exif.gnss = {{47.5, 8.5, 400.25}};
    image.content.bytes[0] = static_cast<std::uint8_t>(i);
    out.block.images.push_back(image);
    if (i == 1 && images > 3) continue;
    const double angle = 0.3 * i;
    const Eigen::Quaterniond rotation(Eigen::AngleAxisd(angle, Eigen::Vector3d(0.1, 1, 0.05).normalized()));
    out.model.cam_from_world[image.id] = Rigid3(rotation, Eigen::Vector3d(0.1 * i, -0.05 * i, 5.0));
  }
  for (int p = 0; p < points; ++p) {
    Point point;
    point.position = {rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-0.5, 0.5)};
    for (auto& c : point.color) c = static_cast<std::uint8_t>(rng.Below(256));
    for (const auto& [id, pose] : out.model.cam_from_world) {
      if (rng.Below(4) == 0) continue;
      const auto projected = out.block.camera_of(id).model.Project(pose * point.position);
      const Eigen::Vector2d residual(noise_px * rng.Normal(), noise_px * rng.Normal());
      point.observations.push_back({{id, static_cast<std::uint32_t>(p)}, *projected - residual, residual});
    }
    out.model.points.push_back(point);
  }
  out.model.sigma0_px = noise_px;
  out.model.redundancy = 123;
  return out;
}

inline CameraModel TestCamera(CameraModelKind kind) {
  CameraModel model{kind, 4400.125, 4400.125, 2003.1, 1490.7};
  if (kind == CameraModelKind::kPinhole || kind == CameraModelKind::kOpenCv || kind == CameraModelKind::kFullOpenCv)
    model.fy = 4411.3;
  if (kind != CameraModelKind::kSimplePinhole && kind != CameraModelKind::kPinhole) model.k1 = -0.1 / 3;
  if (kind == CameraModelKind::kRadial || kind == CameraModelKind::kOpenCv || kind == CameraModelKind::kFullOpenCv)
    model.k2 = 0.05;
  if (kind == CameraModelKind::kOpenCv || kind == CameraModelKind::kFullOpenCv) model.p1 = 1e-3 / 7, model.p2 = -2e-4;
  if (kind == CameraModelKind::kFullOpenCv) model.k3 = -0.01, model.k4 = 0.002, model.k5 = -0.001, model.k6 = 0.0005;
  return model;
}

}  // namespace rilievo
