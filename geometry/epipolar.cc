// Essential matrix and pose, epipolar distances, cheirality.
#include "geometry/epipolar.h"

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <cmath>
#include <limits>

namespace rilievo {
namespace {

double AngleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

}  // namespace

Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

Eigen::Matrix3d EssentialFromPose(const Rigid3& second_from_first) {
  return CrossMatrix(second_from_first.translation) * second_from_first.RotationMatrix();
}

std::array<Rigid3, 4> DecomposeEssential(const Eigen::Matrix3d& essential) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(essential, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d u = svd.matrixU(), vt = svd.matrixV().transpose();
  if (u.determinant() < 0) u = -u;
  if (vt.determinant() < 0) vt = -vt;
  Eigen::Matrix3d w;
  w << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  const Eigen::Matrix3d r1 = u * w * vt, r2 = u * w.transpose() * vt;
  const Eigen::Vector3d t = u.col(2);
  return {Rigid3(r1, t), Rigid3(r1, -t), Rigid3(r2, t), Rigid3(r2, -t)};
}

RayIntersection IntersectRays(const Rigid3& second_from_first, const Eigen::Vector2d& first,
                              const Eigen::Vector2d& second) {
  // a u + t = b v for depths a, b along u = R x and v: cross products with v and with u.
  const Eigen::Vector3d u = second_from_first.rotation * first.homogeneous(), v = second.homogeneous();
  const Eigen::Vector3d& t = second_from_first.translation;
  const Eigen::Vector3d n = u.cross(v);
  return {t.cross(v).dot(n) < 0 && t.cross(u).dot(n) < 0, AngleBetween(u, v)};
}

PoseSelection SelectPose(const Eigen::Matrix3d& essential, std::span<const Eigen::Vector2d> first,
                         std::span<const Eigen::Vector2d> second) {
  const std::array<Rigid3, 4> poses = DecomposeEssential(essential);
  PoseSelection best{poses[0], 0};
  for (std::size_t k = 0; k < poses.size(); k += 2) {  // the second of two has -t: there both depths change sign
    const Eigen::Matrix3d rotation = poses[k].RotationMatrix();
    const Eigen::Vector3d& t = poses[k].translation;
    std::array<std::size_t, 2> in_front{};
    for (std::size_t i = 0; i < first.size(); ++i) {
      const Eigen::Vector3d u = rotation * first[i].homogeneous(), v = second[i].homogeneous(), n = u.cross(v);
      const double a = t.cross(v).dot(n), b = t.cross(u).dot(n);
      in_front[0] += a < 0 && b < 0 ? 1 : 0;
      in_front[1] += a > 0 && b > 0 ? 1 : 0;
    }
    for (std::size_t side = 0; side < 2; ++side) {
      if (in_front[side] > best.in_front) best = {poses[k + side], in_front[side]};
    }
  }
  return best;
}

double SquaredSampson(const Eigen::Matrix3d& m, const Eigen::Vector2d& first, const Eigen::Vector2d& second,
                      const CoordinateVariances& variances) {
  const Eigen::Vector3d line = m * first.homogeneous();
  const Eigen::Vector3d back = m.transpose() * second.homogeneous();
  const double error = second.homogeneous().dot(line);
  return error * error /
         (variances.first * back.head<2>().squaredNorm() + variances.second * line.head<2>().squaredNorm());
}

double SquaredEpipolarDistances(const Eigen::Matrix3d& m, const Eigen::Vector2d& first, const Eigen::Vector2d& second,
                                const CoordinateVariances& variances) {
  const Eigen::Vector3d line = m * first.homogeneous();
  const Eigen::Vector3d back = m.transpose() * second.homogeneous();
  const double error = second.homogeneous().dot(line);
  return error * error *
         (1 / (variances.first * back.head<2>().squaredNorm()) + 1 / (variances.second * line.head<2>().squaredNorm()));
}

double SquaredTransfer(const Eigen::Matrix3d& h, const Eigen::Matrix3d& h_inverse, const Eigen::Vector2d& first,
                       const Eigen::Vector2d& second, const CoordinateVariances& variances) {
  const Eigen::Vector3d there = h * first.homogeneous(), back = h_inverse * second.homogeneous();
  if (!(there.z() * back.z() > 0)) return std::numeric_limits<double>::infinity();
  return 0.5 * ((there.hnormalized() - second).squaredNorm() / variances.second +
                (back.hnormalized() - first).squaredNorm() / variances.first);
}

double ParallaxAngle(const Eigen::Quaterniond& rotation, const Eigen::Vector2d& first, const Eigen::Vector2d& second) {
  return AngleBetween(rotation * first.homogeneous(), second.homogeneous());
}

}  // namespace rilievo
