// The transform of a sketch: cosines over rows and columns of cells, Fourier over directions, all orthonormal.
#include "stages/matching/sketch.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace rilievo::matching {
namespace {

constexpr std::size_t kCells = 4, kDirections = 8, kKept = kSketchBytes - 1;
constexpr std::size_t kDescriptorsPerSample = 16;
/// Least share of the variance in the frequencies kept; with 0.85 about one row in ten is still compared in full.
constexpr double kLeastKeptVariance = 0.85;
constexpr float kMiddleNorm = 92;  ///< of the frequencies left out
/// Single precision on descriptors of norm 721 at most: 23 roundings a coefficient, 2^-24 * 721 each; of all of them
/// together, and of the square of the norm left.
constexpr double kErrorOfSums = 0.01, kErrorOfSquare = 2 * 721 * kErrorOfSums;

/// A coefficient that is kept: its frequencies over rows, columns and directions, and about its mean, which brings its
/// values into the range of a byte (any number is right).
struct Kept {
  std::uint8_t row, column, direction;
  std::int16_t middle;
};
constexpr std::array<Kept, kKept> kKeptCoefficients = {
    {{0, 0, 0, 392}, {0, 0, 1, 56},  {0, 0, 2, 0},   {0, 0, 3, 80}, {0, 0, 4, 0},   {0, 0, 5, 16},  {0, 0, 6, 0},
     {0, 0, 7, 16},  {0, 1, 0, 8},   {0, 1, 1, -16}, {0, 1, 2, 0},  {0, 1, 3, 0},   {0, 1, 4, 0},   {0, 1, 5, 0},
     {0, 1, 6, 0},   {0, 2, 0, -40}, {0, 2, 1, -64}, {0, 2, 2, 0},  {0, 2, 3, -16}, {0, 2, 4, 0},   {0, 2, 5, -16},
     {0, 3, 1, 8},   {0, 3, 3, 0},   {1, 0, 0, 0},   {1, 0, 1, 0},  {1, 0, 2, -8},  {1, 0, 3, 0},   {1, 0, 4, 0},
     {1, 0, 5, 0},   {1, 0, 6, 0},   {1, 1, 0, 0},   {1, 1, 1, 0},  {1, 1, 2, -24}, {1, 1, 3, 0},   {1, 1, 4, 0},
     {1, 2, 1, 0},   {1, 2, 2, 8},   {1, 2, 3, 0},   {1, 2, 4, 0},  {1, 3, 1, 0},   {2, 0, 0, -32}, {2, 0, 1, -8},
     {2, 0, 2, 0},   {2, 0, 3, -16}, {2, 0, 4, 0},   {2, 1, 1, 0},  {2, 1, 2, 0},   {2, 1, 3, 0},   {2, 1, 4, 0},
     {2, 2, 1, 8},   {2, 2, 2, 0},   {2, 3, 1, 0},   {3, 0, 2, 8},  {3, 1, 2, 8},   {3, 2, 2, 0}}};

std::size_t IndexOf(const Kept& kept) { return (kept.row * kCells + kept.column) * kDirections + kept.direction; }

struct Bases {
  std::array<std::array<float, kCells>, kCells> cosines;              ///< by frequency, cell
  std::array<std::array<float, kDirections>, kDirections> harmonics;  ///< by direction, frequency
};

Bases MakeBases() {
  Bases bases{};
  for (std::size_t f = 0; f < kCells; ++f)
    for (std::size_t i = 0; i < kCells; ++i)
      bases.cosines[f][i] = static_cast<float>(
          std::sqrt((f == 0 ? 1.0 : 2.0) / kCells) *
          std::cos(std::numbers::pi * (static_cast<double>(i) + 0.5) * static_cast<double>(f) / kCells));
  for (std::size_t i = 0; i < kDirections; ++i) {
    const double angle_rad = 2 * std::numbers::pi * static_cast<double>(i) / kDirections;
    bases.harmonics[i][0] = static_cast<float>(std::sqrt(1.0 / kDirections));
    for (std::size_t f = 1; f < kDirections / 2; ++f) {
      bases.harmonics[i][2 * f - 1] = static_cast<float>(0.5 * std::cos(static_cast<double>(f) * angle_rad));
      bases.harmonics[i][2 * f] = static_cast<float>(0.5 * std::sin(static_cast<double>(f) * angle_rad));
    }
    bases.harmonics[i][kDirections - 1] = static_cast<float>(std::sqrt(1.0 / kDirections) * (i % 2 == 0 ? 1 : -1));
  }
  return bases;
}

using Coefficients = std::array<float, kDescriptorBytes>;  ///< by row, column and direction frequency

/// out[f][:] = sum over i of cosines[f][i] in[i][:], rows of `kWidth` numbers `stride` apart.
template <std::size_t kWidth>
void CosinesOf(const Bases& bases, const float* in, float* out) {
  for (std::size_t f = 0; f < kCells; ++f) {
    float sum[kWidth] = {};
    for (std::size_t i = 0; i < kCells; ++i)
      for (std::size_t k = 0; k < kWidth; ++k) sum[k] += bases.cosines[f][i] * in[i * kWidth + k];
    std::copy_n(sum, kWidth, out + f * kWidth);
  }
}

Coefficients Transform(const Descriptor& descriptor) {
  static const Bases bases = MakeBases();
  Coefficients directions{}, columns{}, all{};
  for (std::size_t cell = 0; cell < kCells * kCells; ++cell) {
    float sum[kDirections] = {};
    for (std::size_t i = 0; i < kDirections; ++i) {
      const auto value = static_cast<float>(descriptor[cell * kDirections + i]);
      for (std::size_t f = 0; f < kDirections; ++f) sum[f] += value * bases.harmonics[i][f];
    }
    std::copy_n(sum, kDirections, directions.data() + cell * kDirections);
  }
  constexpr std::size_t kRow = kCells * kDirections;
  for (std::size_t row = 0; row < kCells; ++row)
    CosinesOf<kDirections>(bases, directions.data() + row * kRow, columns.data() + row * kRow);
  CosinesOf<kRow>(bases, columns.data(), all.data());
  return all;
}

/// Into the range of a byte around 128, which brings no two values further apart, and rounded.
std::uint8_t ToByte(float value, float& error_sq) {
  const float within = std::clamp(value, -127.0F, 127.0F);
  const auto rounded = static_cast<std::int32_t>(within + 128.5F) - 128;
  const float error = static_cast<float>(rounded) - within;
  error_sq += error * error;
  return static_cast<std::uint8_t>(rounded + 128);
}

}  // namespace

Sketch SketchOf(const Descriptor& descriptor, double& error) {
  const Coefficients coefficients = Transform(descriptor);
  Sketch sketch{};
  float error_sq = 0;
  double left_sq = 0;
  for (const std::uint8_t value : descriptor) left_sq += value * value;
  for (std::size_t k = 0; k < kKept; ++k) {
    const float value = coefficients[IndexOf(kKeptCoefficients[k])];
    left_sq -= double{value} * value;
    sketch[k] = ToByte(value - static_cast<float>(kKeptCoefficients[k].middle), error_sq);
  }
  const double left = std::sqrt(std::max(left_sq, 0.0));
  sketch[kKept] = ToByte(static_cast<float>(left) - kMiddleNorm, error_sq);
  // Of the root of a number with that error: half of it over the root, and no more than its own root.
  const double error_of_left = std::min(kErrorOfSquare / std::max(left, 1e-9), std::sqrt(kErrorOfSquare));
  error = std::sqrt(double{error_sq}) + kErrorOfSums + error_of_left;
  return sketch;
}

bool SketchesPay(std::span<const Descriptor> descriptors) {
  std::array<double, kDescriptorBytes> sums{}, squares{};
  double count = 0;
  for (std::size_t i = 0; i < descriptors.size(); i += kDescriptorsPerSample, ++count) {
    const Coefficients coefficients = Transform(descriptors[i]);
    for (std::size_t k = 0; k < kDescriptorBytes; ++k) {
      sums[k] += coefficients[k];
      squares[k] += double{coefficients[k]} * coefficients[k];
    }
  }
  const auto variance = [&](std::size_t k) { return squares[k] - sums[k] * sums[k] / std::max(count, 1.0); };
  double all = 0, kept = 0;
  for (std::size_t k = 0; k < kDescriptorBytes; ++k) all += variance(k);
  for (const Kept& coefficient : kKeptCoefficients) kept += variance(IndexOf(coefficient));
  return kept > kLeastKeptVariance * all;
}

Sketches MakeSketches(std::span<const Descriptor> descriptors, const Kernel& kernel) {
  Sketches result;
  if (kernel.sweep == nullptr) return result;
  std::vector<Sketch> sketches(descriptors.size());
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    double error = 0;
    sketches[i] = SketchOf(descriptors[i], error);
    result.error = std::max(result.error, error);
  }
  if (!sketches.empty())
    result.packed = Pack({sketches.front().data(), sketches.size(), kSketchBytes}, kernel, kSignedCenter);
  return result;
}

}  // namespace rilievo::matching
