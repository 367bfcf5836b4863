// Umeyama's closed-form similarity.
#include "geometry/similarity3.h"

#include <Eigen/SVD>

#include "base/check.h"

namespace rilievo {

Rigid3 TransformPose(const Similarity3& b_from_a, const Rigid3& cam_from_a) {
  // x_cam ~ R (x_a - C_a) and x_b = s Q x_a + t: the rotation becomes R Q^T and the centre s Q C_a + t.
  const Eigen::Quaterniond rotation = cam_from_a.rotation * b_from_a.rotation.conjugate();
  const Eigen::Vector3d center_b = b_from_a * cam_from_a.Center();
  return {rotation, -(rotation * center_b)};
}

std::optional<Similarity3> FitSimilarity(std::span<const Eigen::Vector3d> x_in_a,
                                         std::span<const Eigen::Vector3d> x_in_b) {
  RILIEVO_CHECK(x_in_a.size() == x_in_b.size());
  const auto n = static_cast<double>(x_in_a.size());
  if (x_in_a.size() < 3) return std::nullopt;
  Eigen::Vector3d mean_a = Eigen::Vector3d::Zero(), mean_b = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < x_in_a.size(); ++i) mean_a += x_in_a[i], mean_b += x_in_b[i];
  mean_a /= n;
  mean_b /= n;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  double variance_a = 0;
  for (std::size_t i = 0; i < x_in_a.size(); ++i) {
    covariance += (x_in_b[i] - mean_b) * (x_in_a[i] - mean_a).transpose();
    variance_a += (x_in_a[i] - mean_a).squaredNorm();
  }
  if (!(variance_a > 0)) return std::nullopt;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d sign(1, 1, (svd.matrixU().determinant() * svd.matrixV().determinant() < 0) ? -1 : 1);
  Similarity3 result;
  result.rotation = Eigen::Quaterniond(Eigen::Matrix3d(svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose()));
  result.rotation.normalize();
  result.scale = svd.singularValues().dot(sign) / variance_a;
  if (!(result.scale > 0)) return std::nullopt;
  result.translation = mean_b - result.scale * (result.rotation * mean_a);
  return result;
}

}  // namespace rilievo
