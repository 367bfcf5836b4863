// k-means with the exact sweep as its search.
#include "stages/matching/cell_centers.h"

#include <array>

#include "stages/matching/two_nearest.h"

namespace rilievo::matching {
namespace {

/// More of either changes the recall by less than 0.1 % (docs/decisions/0011).
constexpr std::size_t kSamplesPerCell = 64;
constexpr int kIterations = 8;

using Sums = std::array<std::uint32_t, sizeof(Descriptor)>;

std::vector<Descriptor> Sample(std::span<const Descriptor> a, std::span<const Descriptor> b, std::size_t count) {
  std::vector<Descriptor> sample(count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t j = i * (a.size() + b.size()) / count;
    sample[i] = j < a.size() ? a[j] : b[j - a.size()];
  }
  return sample;
}

/// Means of the samples that are nearest to each centre, rounded.
void MoveToMeans(std::span<const Descriptor> sample, std::span<const BestTwo> nearest,
                 std::vector<Descriptor>& centers) {
  std::vector<Sums> sums(centers.size(), Sums{});
  std::vector<std::uint32_t> counts(centers.size(), 0);
  for (std::size_t i = 0; i < sample.size(); ++i) {
    Sums& sum = sums[nearest[i].index];
    ++counts[nearest[i].index];
    for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += sample[i][k];
  }
  for (std::size_t cell = 0; cell < centers.size(); ++cell) {
    const std::uint32_t count = counts[cell];
    if (count == 0) continue;
    for (std::size_t k = 0; k < sums[cell].size(); ++k)
      centers[cell][k] = static_cast<std::uint8_t>((sums[cell][k] + count / 2) / count);
  }
}

}  // namespace

std::vector<Descriptor> CellCenters(std::span<const Descriptor> a, std::span<const Descriptor> b, std::size_t cells,
                                    const Kernel& kernel, const RunContext& context) {
  const std::vector<Descriptor> sample = Sample(a, b, cells * kSamplesPerCell);
  std::vector<Descriptor> centers(cells);
  for (std::size_t cell = 0; cell < cells; ++cell) centers[cell] = sample[cell * kSamplesPerCell];
  for (int i = 0; i < kIterations; ++i)
    MoveToMeans(sample, FindTwoNearest(sample, centers, kernel, context).of_a, centers);
  return centers;
}

std::size_t CellCentersBytes(std::size_t cells) {
  return cells * (kSamplesPerCell + 1) * sizeof(Descriptor) + cells * (sizeof(Sums) + 4) +
         TwoNearestBytes(cells * kSamplesPerCell, cells) + PackedBytes(cells * kSamplesPerCell) + PackedBytes(cells);
}

}  // namespace rilievo::matching
