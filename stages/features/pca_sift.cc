// PCA-SIFT: the gradients of a patch (Ke & Sukthankar 2004), projected on their principal components.
#include "stages/features/pca_sift.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "stages/features/descriptor_bytes.h"
#include "stages/features/fixed_math.h"
#include "stages/features/projection.h"

namespace rilievo::features {
namespace {

constexpr int kSamples = kPcaSiftPatch * kPcaSiftPatch, kPaddedSamples = (kSamples + 63) / 64 * 64 + kOvershoot_px;
/// Rows of gradients: one of zeros more, for a multiple of four.
constexpr int kRows = kPcaSiftSide + 1, kFrequencies = kPcaSiftFrequencies;
constexpr int kGradients = 2 * kRows * kPcaSiftSide;
static_assert(kRows % 4 == 0 && kFrequencies % 16 == 0 && kGradients % 16 == 0);

struct PatchTables {
  alignas(64) float u[kPaddedSamples] = {}, v[kPaddedSamples] = {};
  float basis[kPcaSiftSide * kFrequencies], transposed[kFrequencies * kPcaSiftSide];
};

std::unique_ptr<PatchTables> MakePatchTables() {
  auto tables = std::make_unique<PatchTables>();
  for (int k = 0; k < kSamples; ++k) {
    tables->u[k] = 0.5F * static_cast<float>(k % kPcaSiftPatch - kPcaSiftPatch / 2);
    tables->v[k] = 0.5F * static_cast<float>(k / kPcaSiftPatch - kPcaSiftPatch / 2);
  }
  for (int i = 0; i < kPcaSiftSide; ++i) {
    for (int k = 0; k < kFrequencies; ++k) {
      const auto value = static_cast<float>(PcaSiftBasis(i, k));
      tables->basis[i * kFrequencies + k] = tables->transposed[k * kPcaSiftSide + i] = value;
    }
  }
  return tables;
}

/// [horizontal, vertical][kRows][kPcaSiftSide].
void Differences(const float* values, float* gradients) {
  float* vertical = gradients + kRows * kPcaSiftSide;
  for (int row = 0; row < kPcaSiftSide; ++row) {
    const float* middle = values + (row + 1) * kPcaSiftPatch + 1;
    for (int column = 0; column < kPcaSiftSide; ++column) {
      gradients[row * kPcaSiftSide + column] = middle[column + 1] - middle[column - 1];
      vertical[row * kPcaSiftSide + column] = middle[column + kPcaSiftPatch] - middle[column - kPcaSiftPatch];
    }
  }
}

}  // namespace

double PcaSiftBasis(int sample, int frequency) {
  const double angle_rad = std::numbers::pi * (sample + 0.5) * frequency / kPcaSiftSide;
  return std::sqrt((frequency == 0 ? 1.0 : 2.0) / kPcaSiftSide) * SinCos(angle_rad).cos;
}

void PcaSiftCoefficients(const SiftKernels& kernels, const Patch& patch, float cosine, float sine,
                         float* coefficients) {
  static const std::unique_ptr<const PatchTables> tables = MakePatchTables();
  alignas(64) float values[kPaddedSamples];
  float gradients[kGradients] = {}, across[kRows * kFrequencies];
  kernels.sample(patch, {tables->u, tables->v, kSamples}, cosine, sine, values);
  Differences(values, gradients);
  Normalise(gradients, kGradients);
  for (int axis = 0; axis < 2; ++axis) {
    kernels.multiply(gradients + axis * kRows * kPcaSiftSide, kRows, kPcaSiftSide, tables->basis, kFrequencies, across);
    kernels.multiply(tables->transposed, kFrequencies, kPcaSiftSide, across, kFrequencies,
                     coefficients + axis * kFrequencies * kFrequencies);
  }
}

Descriptor DescribePcaSift(const SiftKernels& kernels, const Patch& patch, float cosine, float sine) {
  static const Projection projection(kPcaSiftProjection, kPcaSiftGain);
  float coefficients[kPcaSiftInputs];
  PcaSiftCoefficients(kernels, patch, cosine, sine, coefficients);
  return projection.Describe(kernels, coefficients);
}

}  // namespace rilievo::features
