// Random two-view scenes with exact truth, for tests of relative orientation.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "base/rng.h"
#include "geometry/rigid3.h"

namespace rilievo {

struct TwoViewSceneOptions {
  std::size_t points = 5;
  bool planar = false;
  double outlier_share = 0;  ///< the last points' partners are drawn anywhere in the second image
  double noise = 0;          ///< of each normalised coordinate
  double baseline = 1;       ///< length of the translation; points lie 2 to 6 away
  double max_rotation_rad = 0.6;
};

/// Normalised image coordinates of both images; x_second = second_from_first * x_first.
struct TwoViewScene {
  Rigid3 second_from_first;
  std::vector<Eigen::Vector2d> first, second;
  std::size_t inliers = 0;  ///< the first that many are right

  Eigen::Matrix3d Essential() const {
    const Eigen::Vector3d t = second_from_first.translation.normalized();
    Eigen::Matrix3d cross;
    cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
    return cross * second_from_first.RotationMatrix();
  }
};

inline Eigen::Vector3d RandomDirection(Rng& rng) {
  return Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized();
}

/// Points in front of both cameras, inside a field of view of +-0.55 by +-0.4.
inline TwoViewScene MakeTwoViewScene(Rng& rng, const TwoViewSceneOptions& options) {
  TwoViewScene scene;
  const Eigen::AngleAxisd turn(rng.Uniform(0, options.max_rotation_rad), RandomDirection(rng));
  // Look back at the middle of the scene, so that most points are in both images.
  const Eigen::Vector3d middle(0, 0, 4);
  const Eigen::Vector3d center = options.baseline * RandomDirection(rng);
  const Eigen::Quaterniond look = Eigen::Quaterniond::FromTwoVectors(middle - center, Eigen::Vector3d::UnitZ());
  const Eigen::Quaterniond rotation =
      Eigen::AngleAxisd(rng.Uniform(-1, 1) * options.max_rotation_rad, Eigen::Vector3d::UnitZ()) *
      Eigen::AngleAxisd(0.15 * turn.angle(), turn.axis()) * look;
  scene.second_from_first = Rigid3(rotation, rotation * -center);
  scene.inliers =
      options.points - static_cast<std::size_t>(options.outlier_share * static_cast<double>(options.points) + 0.5);
  const Eigen::Vector3d normal = (Eigen::Vector3d::UnitZ() + 0.5 * RandomDirection(rng)).normalized();
  for (int tries = 0; scene.first.size() < options.points && tries < 1000000; ++tries) {
    const Eigen::Vector2d x(rng.Uniform(-0.55, 0.55), rng.Uniform(-0.4, 0.4));
    const double depth = options.planar ? 4 * normal.z() / normal.dot(x.homogeneous()) : rng.Uniform(2, 6);
    const Eigen::Vector3d in_second = scene.second_from_first * (depth * x.homogeneous());
    Eigen::Vector2d y(rng.Uniform(-0.55, 0.55), rng.Uniform(-0.4, 0.4));
    if (scene.first.size() < scene.inliers) {
      if (depth < 0.5 || in_second.z() < 0.5) continue;
      y = in_second.hnormalized();
      if (std::abs(y.x()) > 0.55 || std::abs(y.y()) > 0.4) continue;
    }
    const auto noisy = [&](const Eigen::Vector2d& p) {
      return options.noise > 0 ? Eigen::Vector2d(p + options.noise * Eigen::Vector2d(rng.Normal(), rng.Normal())) : p;
    };
    scene.first.push_back(noisy(x));
    scene.second.push_back(noisy(y));
  }
  return scene;
}

}  // namespace rilievo
