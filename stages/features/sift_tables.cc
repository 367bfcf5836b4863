// The constant tables of SIFT's kernels.
#include <cmath>
#include <memory>

#include "stages/features/fixed_math.h"
#include "stages/features/sift_kernels.h"

namespace rilievo::features {
namespace {

/// Second moment of linear interpolation a quarter pixel off the samples.
constexpr double kLinearVariance_px2 = 0.25 * 0.75;

double Gaussian(double d, double sigma) { return Exp(-d * d / (2 * sigma * sigma)); }

/// Weights of sample positions first, first + 1, ... scaled to the sum 1.
template <class F>
void FillNormalised(float* weights, int count, F&& weight_at) {
  double sum = 0;
  for (int i = 0; i < count; ++i) sum += weight_at(i);
  for (int i = 0; i < count; ++i) weights[i] = static_cast<float>(weight_at(i) / sum);
}

/// Linear interpolation followed by a Gaussian, as one kernel: their convolution at distance d, by the midpoint rule.
/// The interpolation alone blurs by kLinearVariance_px2.
double BlurredLinear(double d, double sigma) {
  constexpr int kSteps = 400;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double t = -1 + 2 * (i + 0.5) / kSteps;
    sum += (1 - std::fabs(t)) * Gaussian(d - t, sigma);
  }
  return sum;
}

void FillPatch(SiftTables& tables) {
  for (int k = 0; k < kPatchSide * kPatchSide; ++k) {
    const double half = 0.5 * (kPatchSide - 1), u = k % kPatchSide - half, v = k / kPatchSide - half;
    tables.patch_u[k] = static_cast<float>(u);
    tables.patch_v[k] = static_cast<float>(v);
    const double column = u / kCellSamples + 0.5 * (kCells - 1), row = v / kCellSamples + 0.5 * (kCells - 1);
    const double weight = Gaussian(std::sqrt(u * u + v * v) / kCellSamples, 0.5 * kCells);
    for (int i = 0; i < 2 * kCells; ++i) {
      const double cell_row = std::floor(row) + i / kCells, cell_column = i % kCells;
      tables.cell_weights[k][i] = static_cast<float>(weight * std::fmax(0.0, 1 - std::fabs(row - cell_row)) *
                                                     std::fmax(0.0, 1 - std::fabs(column - cell_column)));
    }
  }
}

void FillOrientation(SiftTables& tables) {
  constexpr int kHalf = kOrientationSide / 2;
  for (int k = 0; k < kOrientationSide * kOrientationSide; ++k) {
    const int u = k % kOrientationSide - kHalf, v = k / kOrientationSide - kHalf;
    tables.orientation_u[k] = static_cast<float>(u);
    tables.orientation_v[k] = static_cast<float>(v);
    const double radius_sigma = std::sqrt(static_cast<double>(u * u + v * v)) * kSampleStep_sigma;
    const bool is_inside = radius_sigma <= kOrientationRadius_sigma && std::abs(u) < kHalf && std::abs(v) < kHalf;
    tables.orientation_weights[k] =
        is_inside ? static_cast<float>(Gaussian(radius_sigma, kOrientationWeight_sigma)) : 0.0F;
  }
}

std::unique_ptr<SiftTables> MakeTables() {
  auto tables = std::make_unique<SiftTables>();
  FillPatch(*tables);
  FillOrientation(*tables);
  for (std::size_t i = 0; i < kBlurs; ++i) {
    const double before = LayerSigma(static_cast<double>(i), 0), after = LayerSigma(static_cast<double>(i) + 1, 0);
    const double sigma = std::sqrt(after * after - before * before);
    const int r = kBlurRadius_px[i];
    FillNormalised(tables->blur_weights[i], 2 * r + 1, [&](int t) { return Gaussian(t - r, sigma); });
  }
  // In pixels of the image: what is left when the camera and the interpolation have blurred.
  const double doubled =
      std::sqrt(0.25 * kDoubledSigma * kDoubledSigma - kCameraSigma * kCameraSigma - kLinearVariance_px2);
  FillNormalised(tables->upsample_weights, kUpsampleTaps + 1,
                 [&](int t) { return BlurredLinear(t - kUpsampleRadius_px + 0.25, doubled); });
  const double first = std::sqrt(kBaseSigma * kBaseSigma - kCameraSigma * kCameraSigma);
  FillNormalised(tables->first_blur_weights, 2 * kFirstBlurRadius_px + 1,
                 [&](int t) { return Gaussian(t - kFirstBlurRadius_px, first); });
  return tables;
}

}  // namespace

double LayerSigma(double layer, double surplus_px2) {
  return std::sqrt(kBaseSigma * kBaseSigma * Exp2(2 * layer / kScales) + surplus_px2);
}

const SiftTables& Tables() {
  static const std::unique_ptr<const SiftTables> tables = MakeTables();
  return *tables;
}

}  // namespace rilievo::features
