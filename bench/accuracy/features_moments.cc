// Means and covariances of what GLOH and PCA-SIFT project, over the features of images.
#include "bench/accuracy/features_moments.h"

#include "base/run_context.h"
#include "stages/features/features.h"
#include "stages/features/gloh.h"
#include "stages/features/kernel_choice.h"
#include "stages/features/pca_sift.h"
#include "stages/features/sift.h"

namespace rilievo::bench {
namespace {

using features::kGlohBins, features::kPcaSiftInputs;

Eigen::MatrixXd Columns(const std::vector<float>& values, int rows) {
  return Eigen::Map<const Eigen::MatrixXf>(values.data(), rows, static_cast<Eigen::Index>(values.size()) / rows)
      .cast<double>();
}

}  // namespace

void Moments::Add(const Eigen::MatrixXd& vectors) {
  sum_ += vectors.rowwise().sum();
  scatter_.noalias() += vectors * vectors.transpose();
  count_ += static_cast<std::size_t>(vectors.cols());
}

void Moments::Symmetrise(const std::vector<int>& to, const std::vector<double>& sign) {
  const Eigen::VectorXd sum = sum_;
  const Eigen::MatrixXd scatter = scatter_;
  for (std::size_t i = 0; i < to.size(); ++i) {
    sum_(to[i]) += sign[i] * sum(static_cast<Eigen::Index>(i));
    for (std::size_t j = 0; j < to.size(); ++j)
      scatter_(to[i], to[j]) += sign[i] * sign[j] * scatter(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
  }
  count_ *= 2;
}

Eigen::MatrixXd Moments::Covariance() const {
  return scatter_ / static_cast<double>(count_) - Mean() * Mean().transpose();
}

DescriptorMoments::DescriptorMoments() : gloh(kGlohBins), pca_sift(kPcaSiftInputs) {}

void DescriptorMoments::Add(const GreyImage& image) {
  std::vector<float> histograms, coefficients;
  const features::Describer describe = [&](const auto& kernels, const auto& patch, float cosine, float sine) {
    histograms.resize(histograms.size() + kGlohBins);
    features::GlohHistogram(kernels, patch, cosine, sine, &histograms[histograms.size() - kGlohBins]);
    coefficients.resize(coefficients.size() + kPcaSiftInputs);
    features::PcaSiftCoefficients(kernels, patch, cosine, sine, &coefficients[coefficients.size() - kPcaSiftInputs]);
    return Descriptor{};
  };
  SerialRunContext context;
  const features::Options options;
  features::DetectSift(
      {image}, {options.first_octave, {options.contrast_threshold, options.edge_threshold}, options.octaves, describe},
      {1 << 20, false, image.width_px, image.height_px}, features::ChooseSiftKernels(features::ForcedKernels()),
      context);
  gloh.Add(Columns(histograms, kGlohBins));
  pca_sift.Add(Columns(coefficients, kPcaSiftInputs));
}

Eigen::MatrixXd Rows(const features::StoredProjection& stored) {
  Eigen::MatrixXd rows(stored.outputs, stored.inputs);
  for (int o = 0; o < stored.outputs; ++o)
    for (int i = 0; i < stored.inputs; ++i)
      rows(o, i) = static_cast<double>(stored.scales[o]) * stored.weights[o * stored.inputs + i];
  return rows;
}

}  // namespace rilievo::bench
