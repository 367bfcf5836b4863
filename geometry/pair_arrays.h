// Pairs of points as the columns that the kernels of refinements read.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "geometry/kernels/two_view_kernels.h"

namespace rilievo {

/// Ideal coordinates of pairs, a coordinate an array, padded with zeros to whole vectors.
class PairArrays {
 public:
  explicit PairArrays(std::size_t size) : size_(size), stride_((size + 7) / 8 * 8), values_(4 * stride_) {}
  PairArrays(std::span<const Eigen::Vector2d> first, std::span<const Eigen::Vector2d> second)
      : PairArrays(first.size()) {
    for (std::size_t i = 0; i < size_; ++i) Set(i, first[i], second[i]);
  }
  void Set(std::size_t i, const Eigen::Vector2d& first, const Eigen::Vector2d& second) {
    values_[i] = first.x();
    values_[stride_ + i] = first.y();
    values_[2 * stride_ + i] = second.x();
    values_[3 * stride_ + i] = second.y();
  }
  std::size_t Size() const { return size_; }
  PairColumns Columns() const {
    const double* v = values_.data();
    return {v, v + stride_, v + 2 * stride_, v + 3 * stride_, static_cast<int>(size_)};
  }
  /// First and second image exchanged.
  PairColumns Reversed() const {
    const PairColumns c = Columns();
    return {c.x2, c.y2, c.x1, c.y1, c.size};
  }

 private:
  std::size_t size_, stride_;
  std::vector<double> values_;
};

}  // namespace rilievo
