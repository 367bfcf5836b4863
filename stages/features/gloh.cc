// GLOH: gradients in a log-polar grid (Mikolajczyk & Schmid 2005), projected on their principal components.
#include "stages/features/gloh.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "stages/features/descriptor_bytes.h"
#include "stages/features/fixed_math.h"
#include "stages/features/projection.h"

namespace rilievo::features {
namespace {

/// A sample of the patch and its shares in the cells: two sectors of two rings.
struct Share {
  int sample = 0;
  int cell[4] = {};
  float weight[4] = {};
};

/// Hat functions between the middles of the rings: share of the outer one of `ring` and `ring` + 1.
struct RingShare {
  int ring = 0;
  double outer = 0;
};
RingShare RingsAt(double radius) {
  const double middle[3] = {0.5 * kGlohRadii[0], 0.5 * (kGlohRadii[0] + kGlohRadii[1]),
                            0.5 * (kGlohRadii[1] + kGlohRadii[2])};
  const int ring = radius < middle[1] ? 0 : 1;
  return {ring, std::clamp((radius - middle[ring]) / (middle[ring + 1] - middle[ring]), 0.0, 1.0)};
}

/// Position among the sectors, [0, 8): sector s has its middle at s eighths of a turn. From the sector's own middle,
/// tan(angle) = y / x with |angle| <= pi / 8.
double SectorAt(double u, double v) {
  double best = -1, position = 0;
  for (int s = 0; s < kGlohSectors; ++s) {
    const SinCosValue axis = SinCos(2 * std::numbers::pi * s / kGlohSectors);
    const double along = axis.cos * u + axis.sin * v, across = axis.cos * v - axis.sin * u;
    if (along <= best) continue;
    best = along;
    const double t = across / along;
    double angle = 0;  // arctangent, |t| <= 0.42
    for (int k = 31; k >= 1; k -= 2) angle = 1.0 / k - t * t * angle;
    position = s + angle * t * kGlohSectors / (2 * std::numbers::pi);
  }
  return position < 0 ? position + kGlohSectors : position;
}

std::vector<Share> MakeShares() {
  std::vector<Share> shares;
  const double step = kSampleStep_sigma / kGlohUnits_sigma, half = 0.5 * (kPatchSide - 1),
               window = 2 * kCellWidth_sigma;
  for (int k = 0; k < kPatchSide * kPatchSide; ++k) {
    const int column = k % kPatchSide, row = k / kPatchSide;
    const double u = (column - half) * step, v = (row - half) * step, radius = std::sqrt(u * u + v * v);
    if (std::min(column, row) == 0 || std::max(column, row) == kPatchSide - 1 || radius > kGlohRadii[2]) continue;
    const RingShare rings = RingsAt(radius);
    const double sector = SectorAt(u, v), lower = std::floor(sector), upper_share = sector - lower;
    const double distance = radius * kGlohUnits_sigma / window, gaussian = Exp(-0.5 * distance * distance);
    Share share{.sample = k};
    for (int i = 0; i < 4; ++i) {
      const int ring = rings.ring + i / 2, s = (static_cast<int>(lower) + i % 2) % kGlohSectors;
      share.cell[i] = ring == 0 ? 0 : 1 + (ring - 1) * kGlohSectors + s;
      share.weight[i] = static_cast<float>(gaussian * (i / 2 == 0 ? 1 - rings.outer : rings.outer) *
                                           (i % 2 == 0 ? 1 - upper_share : upper_share));
    }
    shares.push_back(share);
  }
  return shares;
}

}  // namespace

void GlohHistogram(const SiftKernels& kernels, const Patch& patch, float cosine, float sine, float* histogram) {
  static const std::vector<Share> shares = MakeShares();
  alignas(64) float magnitude[kGradientFloats], turns[kGradientFloats];
  kernels.gradients(patch, cosine, sine, magnitude, turns);
  std::fill_n(histogram, kGlohBins, 0.0F);
  for (const Share& share : shares) {
    const float position = turns[share.sample] * kGlohDirections;
    const int whole = static_cast<int>(position);
    const float upper = magnitude[share.sample] * (position - static_cast<float>(whole));
    const float lower = magnitude[share.sample] - upper;
    const int bin = whole & (kGlohDirections - 1), next = (whole + 1) & (kGlohDirections - 1);
    for (int i = 0; i < 4; ++i) {
      float* cell = histogram + share.cell[i] * kGlohDirections;
      cell[bin] += share.weight[i] * lower;
      cell[next] += share.weight[i] * upper;
    }
  }
  Normalise(histogram, kGlohBins);
  for (int i = 0; i < kGlohBins; ++i) histogram[i] = std::min(histogram[i], 0.2F);
  Normalise(histogram, kGlohBins);
}

Descriptor DescribeGloh(const SiftKernels& kernels, const Patch& patch, float cosine, float sine) {
  static const Projection projection(kGlohProjection, kGlohGain);
  float histogram[kGlohBins];
  GlohHistogram(kernels, patch, cosine, sine, histogram);
  return projection.Describe(kernels, histogram);
}

}  // namespace rilievo::features
