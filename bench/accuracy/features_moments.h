// Means and covariances of what GLOH and PCA-SIFT project, over the features of images.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "block/pixels.h"
#include "stages/features/projection.h"

namespace rilievo::bench {

class Moments {
 public:
  explicit Moments(int size) : sum_(Eigen::VectorXd::Zero(size)), scatter_(Eigen::MatrixXd::Zero(size, size)) {}
  /// Columns are vectors.
  void Add(const Eigen::MatrixXd& vectors);
  /// Averages with the moments of all vectors changed so: element i goes to to[i], times sign[i]. Twice must be once.
  void Symmetrise(const std::vector<int>& to, const std::vector<double>& sign);
  std::size_t count() const { return count_; }
  Eigen::VectorXd Mean() const { return sum_ / static_cast<double>(count_); }
  Eigen::MatrixXd Covariance() const;

 private:
  Eigen::VectorXd sum_;
  Eigen::MatrixXd scatter_;
  std::size_t count_ = 0;
};

struct DescriptorMoments {
  Moments gloh, pca_sift;
  DescriptorMoments();
  /// All features of an image that SIFT finds by its default options, in the order in which it finds them.
  void Add(const GreyImage& image);
};

/// The rows of a stored projection.
Eigen::MatrixXd Rows(const features::StoredProjection& stored);

}  // namespace rilievo::bench
