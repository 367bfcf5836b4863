// Synthetic blocks as the mapper sees them: exact cameras and points, projections with noise and wrong matches.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "base/rng.h"
#include "block/block.h"
#include "block/features.h"
#include "block/model.h"
#include "block/pair.h"
#include "block/track.h"
#include "geometry/rigid3.h"

namespace rilievo::test {

enum class Layout { kArc, kRing, kRotation };
enum class Object { kRelief, kPlane, kSphere };

struct SyntheticOptions {
  Layout layout = Layout::kArc;
  Object object = Object::kRelief;
  int images = 8, points = 1200;
  double noise_px = 0;
  double wrong_share = 0;   ///< of rays: their feature lies anywhere in the image
  int sequence_window = 0;  ///< pairs of images at most so far apart (cyclic in a ring); 0 = all
  int scenes = 1;           ///< disconnected copies, `images` each
  CameraModel camera{.kind = CameraModelKind::kPinhole, .fx = 1500, .fy = 1510, .cx = 752.5, .cy = 497};
  std::uint64_t seed = 1;
};

struct SyntheticBlock {
  Block block;
  std::vector<Rigid3> cam_from_world;
  std::vector<Eigen::Vector3d> points;
  std::vector<std::vector<Keypoint>> keypoints;
  std::vector<std::vector<Rgb>> colors;
  std::vector<TwoViewGeometry> pairs;
  std::vector<Track> tracks;
  std::vector<std::uint32_t> point_of_track;
  std::set<FeatureRef> wrong;  ///< features that are not where their point projects
};

/// Camera at `center` looking at `target`, y down along `down` as far as possible.
inline Rigid3 LookAt(const Eigen::Vector3d& center, const Eigen::Vector3d& target, const Eigen::Vector3d& down) {
  const Eigen::Vector3d z = (target - center).normalized(), x = down.cross(z).normalized(), y = z.cross(x);
  Eigen::Matrix3d rotation;
  rotation << x.transpose(), y.transpose(), z.transpose();
  return {rotation, -(rotation * center)};
}

namespace synthetic_internal {

inline Rigid3 CameraOf(const SyntheticOptions& o, int i, Rng& rng) {
  const Eigen::Vector3d down(0, 1, 0),
      jitter(rng.Uniform(-0.05, 0.05), rng.Uniform(-0.05, 0.05), rng.Uniform(-0.05, 0.05));
  if (o.layout == Layout::kRing) {
    const double a = 2 * std::numbers::pi * i / o.images;
    return LookAt(3.5 * Eigen::Vector3d(std::sin(a), 0.1, -std::cos(a)) + jitter, jitter, down);
  }
  const double a = o.images > 1 ? -0.5 + 1.0 * i / (o.images - 1) : 0;
  if (o.layout == Layout::kRotation) return LookAt({0, 0, -3.2}, {0.5 * a, 0.2 * a, 0}, down);
  return LookAt(3.2 * Eigen::Vector3d(std::sin(a), 0.15 * std::sin(7 * a), -std::cos(a)) + jitter, jitter, down);
}

inline Eigen::Vector3d PointOf(const SyntheticOptions& o, Rng& rng) {
  if (o.object == Object::kSphere) return Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized();
  const double x = rng.Uniform(-1.1, 1.1), y = rng.Uniform(-0.8, 0.8);
  return {x, y, o.object == Object::kPlane ? 0.0 : 0.2 * std::sin(5 * x) * std::cos(4 * y) + 0.1 * rng.Uniform()};
}

inline bool Faces(const SyntheticOptions& o, const Eigen::Vector3d& point, const Rigid3& pose) {
  return o.object != Object::kSphere || point.dot((pose.Center() - point).normalized()) > 0.35;
}

inline double MedianAngle(const SyntheticBlock& b, const TwoViewGeometry& g,
                          const std::vector<std::uint32_t>& shared_points) {
  std::vector<double> angles;
  for (const std::uint32_t p : shared_points) {
    const Eigen::Vector3d u = b.points[p] - b.cam_from_world[g.pair.first.value].Center(),
                          v = b.points[p] - b.cam_from_world[g.pair.second.value].Center();
    angles.push_back(std::atan2(u.cross(v).norm(), u.dot(v)));
  }
  std::nth_element(angles.begin(), angles.begin() + static_cast<std::ptrdiff_t>(angles.size() / 2), angles.end());
  return angles[angles.size() / 2];
}

inline void AddPairs(const SyntheticOptions& o, SyntheticBlock& b) {
  const auto n = static_cast<std::uint32_t>(b.block.images.size());
  for (std::uint32_t i = 0; i < n; ++i)
    for (std::uint32_t j = i + 1; j < n; ++j) {
      if (i / static_cast<std::uint32_t>(o.images) != j / static_cast<std::uint32_t>(o.images)) continue;
      int apart = static_cast<int>(j - i);
      if (o.layout == Layout::kRing) apart = std::min(apart, o.images - apart);
      if (o.sequence_window > 0 && apart > o.sequence_window) continue;
      TwoViewGeometry g;
      g.pair = {ImageId(i), ImageId(j)};
      std::vector<std::uint32_t> shared;
      for (std::size_t t = 0; t < b.tracks.size(); ++t) {
        const FeatureRef *first = nullptr, *second = nullptr;
        for (const FeatureRef& e : b.tracks[t].elements) {
          if (e.image == g.pair.first) first = &e;
          if (e.image == g.pair.second) second = &e;
        }
        if (first == nullptr || second == nullptr || b.wrong.contains(*first) || b.wrong.contains(*second)) continue;
        g.inliers.push_back({first->feature, second->feature});
        shared.push_back(b.point_of_track[t]);
      }
      g.matches = static_cast<std::uint32_t>(g.inliers.size());
      if (g.inliers.size() < 20) {
        g.reason = RejectionReason::kTooFewInliers;
        g.inliers.clear();
      } else {
        std::sort(g.inliers.begin(), g.inliers.end());
        g.second_from_first = b.cam_from_world[j] * b.cam_from_world[i].Inverse();
        const double length = g.second_from_first.translation.norm();
        g.second_from_first.translation =
            length > 1e-9 ? Eigen::Vector3d(g.second_from_first.translation / length) : Eigen::Vector3d::Zero();
        g.median_angle_rad = MedianAngle(b, g, shared);
        const bool flat = o.object == Object::kPlane || length <= 1e-9;
        g.model = flat ? TwoViewModel::kHomography : TwoViewModel::kEssential;
        g.homography_ratio = flat ? 1 : 0.3;
      }
      b.pairs.push_back(std::move(g));
    }
}

}  // namespace synthetic_internal

/// Deterministic in the options. Image k of scene s has id s * images + k.
inline SyntheticBlock MakeSyntheticBlock(const SyntheticOptions& o) {
  using namespace synthetic_internal;
  Rng rng(o.seed);
  SyntheticBlock b;
  constexpr int kWidth = 1500, kHeight = 1000;
  b.block.cameras.push_back({CameraId(0), o.camera, kWidth, kHeight, CalibrationSource::kGiven, "synthetic"});
  for (int i = 0; i < o.images * o.scenes; ++i) {
    Image image;
    image.id = ImageId(static_cast<std::uint32_t>(i));
    image.camera_id = CameraId(0);
    image.name = "IMG_" + std::to_string(i) + ".jpg";
    image.width_px = kWidth, image.height_px = kHeight, image.channels = 3;
    b.block.images.push_back(image);
    b.cam_from_world.push_back(CameraOf(o, i % o.images, rng));
  }
  b.keypoints.resize(b.block.images.size());
  b.colors.resize(b.block.images.size());
  for (int s = 0; s < o.scenes; ++s)
    for (int p = 0; p < o.points; ++p) {
      const Eigen::Vector3d point = PointOf(o, rng);
      Track track;
      for (int k = 0; k < o.images; ++k) {
        const auto i = static_cast<std::uint32_t>(s * o.images + k);
        const Rigid3& pose = b.cam_from_world[i];
        const auto exact = o.camera.Project(pose * point);
        if (!exact || !Faces(o, point, pose)) continue;
        Eigen::Vector2d at = *exact + o.noise_px * Eigen::Vector2d(rng.Normal(), rng.Normal());
        if (at.x() < 0 || at.y() < 0 || at.x() > kWidth || at.y() > kHeight) continue;
        const FeatureRef feature{ImageId(i), static_cast<std::uint32_t>(b.keypoints[i].size())};
        if (rng.Uniform() < o.wrong_share) {
          at = {rng.Uniform(0, kWidth), rng.Uniform(0, kHeight)};
          b.wrong.insert(feature);
        }
        b.keypoints[i].push_back({static_cast<float>(at.x()), static_cast<float>(at.y()), 2.0F, 0.0F, 0.1F});
        b.colors[i].push_back({static_cast<std::uint8_t>(p % 256), 100, 50});
        track.elements.push_back(feature);
      }
      if (track.elements.size() < 2) continue;
      b.point_of_track.push_back(static_cast<std::uint32_t>(b.points.size()));
      b.points.push_back(point);
      b.tracks.push_back(std::move(track));
    }
  AddPairs(o, b);
  return b;
}

}  // namespace rilievo::test
