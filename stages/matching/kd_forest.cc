// Builds the trees and searches them (docs/decisions/0011-kd-tree-matching.md).
#include "stages/matching/kd_forest.h"

#include <algorithm>
#include <array>
#include <numeric>

#include "base/rng.h"
#include "stages/matching/best_two.h"

namespace rilievo::matching {
namespace {

/// Points a leaf holds at most unless they are equal: two rounds of a distance kernel.
constexpr std::size_t kLeafPoints = 8;
/// Points whose variance chooses a split.
constexpr std::size_t kSample = 96;
constexpr std::size_t kBytes = sizeof(Descriptor), kCandidates = 5;
constexpr std::uint64_t kSeed = 0x6b642d74726565;  // trees depend on the descriptors alone
constexpr std::uint32_t kNoBranch = 0xffffffffU;

/// Sums over a sample of a range of points, spread evenly.
struct Moments {
  std::uint32_t count = 0;
  std::array<std::uint32_t, kBytes> sum{}, square{};

  /// count^2 times the variance: at most 96^2 * 255^2 < 2^30.
  std::uint32_t Spread(std::size_t k) const { return count * square[k] - sum[k] * sum[k]; }
};

Moments MomentsOf(std::span<const Descriptor> points, std::span<const std::uint32_t> range) {
  Moments m;
  m.count = static_cast<std::uint32_t>(std::min(range.size(), kSample));
  for (std::size_t i = 0; i < m.count; ++i) {
    const Descriptor& point = points[range[i * range.size() / m.count]];
    for (std::size_t k = 0; k < kBytes; ++k) {
      m.sum[k] += point[k];
      m.square[k] += std::uint32_t{point[k]} * point[k];
    }
  }
  return m;
}

struct Split {
  std::uint8_t dimension = KdForest::kNoByte, value = 0;
};

/// Above the mean of a byte that varies, so that neither side is empty; none if the sample does not vary.
Split ChooseSplit(const Moments& m, bool is_random, std::uint64_t seed) {
  std::array<std::uint8_t, kBytes> bytes{};
  std::iota(bytes.begin(), bytes.end(), std::uint8_t{0});
  const std::size_t wanted = is_random ? kCandidates : 1;
  std::partial_sort(
      bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(wanted), bytes.end(),
      [&](std::uint8_t a, std::uint8_t b) { return m.Spread(a) != m.Spread(b) ? m.Spread(a) > m.Spread(b) : a < b; });
  std::size_t varying = 0;
  while (varying < wanted && m.Spread(bytes[varying]) > 0) ++varying;
  if (varying == 0) return {};
  const std::uint8_t dimension = bytes[is_random ? Rng(seed).Below(static_cast<std::uint32_t>(varying)) : 0];
  return {dimension, static_cast<std::uint8_t>(m.sum[dimension] / m.count + 1)};
}

/// The sample may be equal where the points are not: then the first byte in which one differs from the first point.
Split SplitOffFirst(std::span<const Descriptor> points, std::span<const std::uint32_t> range) {
  const Descriptor& first = points[range.front()];
  for (const std::uint32_t index : range) {
    for (std::size_t k = 0; k < kBytes; ++k) {
      if (points[index][k] == first[k]) continue;
      return {static_cast<std::uint8_t>(k), std::max(points[index][k], first[k])};
    }
  }
  return {};
}

}  // namespace

KdForest::KdForest(std::span<const Descriptor> points, int trees) : points_(points) {
  if (points.empty()) return;
  const auto count = static_cast<std::size_t>(trees);
  order_.resize(count * points.size());
  for (std::size_t tree = 0; tree < count; ++tree) AddTree(tree, count);
}

void KdForest::AddTree(std::size_t tree, std::size_t trees) {
  const std::size_t tree_begin = tree * points_.size();
  std::iota(order_.begin() + static_cast<std::ptrdiff_t>(tree_begin),
            order_.begin() + static_cast<std::ptrdiff_t>(tree_begin + points_.size()), 0U);
  /// Depth first, first child first: a node's first child is the next node. `patch` awaits the second child's number.
  struct Open {
    std::size_t begin, end;
    std::uint32_t patch;
  };
  std::vector<Open> open = {{tree_begin, tree_begin + points_.size(), kNoBranch}};
  const auto root = static_cast<std::uint32_t>(nodes_.size());
  roots_.push_back(root);
  while (!open.empty()) {
    const auto [begin, end, patch] = open.back();
    open.pop_back();
    const auto node = static_cast<std::uint32_t>(nodes_.size());
    if (patch != kNoBranch) nodes_[patch].second = node;
    const std::span<std::uint32_t> range = std::span(order_).subspan(begin, end - begin);
    Split split;
    if (range.size() > kLeafPoints) {
      split = ChooseSplit(MomentsOf(points_, range), trees > 1, SeedFor(kSeed, tree, node - root));
      if (split.dimension == kNoByte) split = SplitOffFirst(points_, range);
    }
    if (split.dimension == kNoByte) {
      nodes_.push_back({.second = static_cast<std::uint32_t>(end), .begin = static_cast<std::uint32_t>(begin)});
      continue;
    }
    nodes_.push_back({.dimension = split.dimension, .split = split.value});
    const auto middle = std::stable_partition(
        range.begin(), range.end(), [&](std::uint32_t index) { return points_[index][split.dimension] < split.value; });
    const std::size_t border = begin + static_cast<std::size_t>(middle - range.begin());
    open.push_back({border, end, node});
    open.push_back({begin, border, kNoBranch});
  }
}

KdSearch::KdSearch(const KdForest& forest, DistanceKernel distances)
    : forest_(forest), distances_(distances), stamps_(forest.points().size(), 0) {}

/// Ties of bounds go to the older branch: a total order.
void KdSearch::Push(const Branch& branch) {
  heap_.push_back({branch.bound_sq, static_cast<std::uint32_t>(branches_.size())});
  branches_.push_back(branch);
  std::push_heap(heap_.begin(), heap_.end(), [](const HeapEntry& a, const HeapEntry& b) {
    return a.bound_sq != b.bound_sq ? a.bound_sq > b.bound_sq : a.branch > b.branch;
  });
}

std::uint32_t KdSearch::Pop() {
  std::pop_heap(heap_.begin(), heap_.end(), [](const HeapEntry& a, const HeapEntry& b) {
    return a.bound_sq != b.bound_sq ? a.bound_sq > b.bound_sq : a.branch > b.branch;
  });
  const std::uint32_t branch = heap_.back().branch;
  heap_.pop_back();
  return branch;
}

/// Squared distance of a branch's cell from the query in one byte: that of the last split of this byte on the way.
std::int32_t KdSearch::OffsetSq(std::uint32_t branch, std::uint8_t dimension) const {
  for (; branch != kNoBranch; branch = branches_[branch].parent) {
    if (branches_[branch].dimension == dimension) return branches_[branch].offset_sq;
  }
  return 0;
}

/// The query's leaf below a branch; the sides that were left become branches. Splits on the query's own side of a cell
/// that lies off in this byte move the cell no further away.
std::uint32_t KdSearch::Descend(const Descriptor& query, std::uint32_t branch) {
  std::uint32_t node = branches_[branch].node;
  while (!forest_.nodes()[node].IsLeaf()) {
    const KdForest::Node& inner = forest_.nodes()[node];
    const std::int32_t value = query[inner.dimension], split = inner.split;
    const bool is_first = value < split;
    const std::int32_t offset = is_first ? split - value : value - (split - 1);
    const std::int32_t offset_sq = offset * offset;
    const std::int32_t bound_sq = branches_[branch].bound_sq - OffsetSq(branch, inner.dimension) + offset_sq;
    Push({.node = is_first ? inner.second : node + 1,
          .parent = branch,
          .bound_sq = bound_sq,
          .offset_sq = offset_sq,
          .dimension = inner.dimension});
    node = is_first ? node + 1 : inner.second;
  }
  return node;
}

std::size_t KdSearch::CompareLeaf(const Descriptor& query, const KdForest::Node& leaf, BestTwo& best) {
  fresh_.clear();
  for (const std::uint32_t index : forest_.order().subspan(leaf.begin, leaf.second - leaf.begin)) {
    if (stamps_[index] == stamp_) continue;
    stamps_[index] = stamp_;
    fresh_.push_back(index);
  }
  fresh_sq_.resize(fresh_.size());
  distances_(query.data(), forest_.points().front().data(), fresh_.data(), fresh_.size(), fresh_sq_.data());
  for (std::size_t i = 0; i < fresh_.size(); ++i) Offer(best, fresh_sq_[i], fresh_[i]);
  return fresh_.size();
}

BestTwo KdSearch::Find(const Descriptor& query, std::size_t checks) {
  BestTwo best;
  if (++stamp_ == 0) {
    std::fill(stamps_.begin(), stamps_.end(), 0);
    stamp_ = 1;
  }
  branches_.clear();
  heap_.clear();
  for (const std::uint32_t root : forest_.roots())
    Push({.node = root, .parent = kNoBranch, .bound_sq = 0, .offset_sq = 0, .dimension = KdForest::kNoByte});
  std::size_t compared = 0;
  while (!heap_.empty() && (checks == 0 || compared < checks)) {
    // A cell as far as the second neighbour may hold one as near as the first with a lower index.
    if (heap_.front().bound_sq > best.second_sq) break;
    const std::uint32_t leaf = Descend(query, Pop());
    compared += CompareLeaf(query, forest_.nodes()[leaf], best);
  }
  return best;
}

std::size_t KdForestBytes(std::size_t points, int trees) {
  // At most two nodes a point and tree in vectors that may have doubled, the order, the stamps; a search's branches.
  const auto count = static_cast<std::size_t>(trees);
  return points * (count * (4 * sizeof(KdForest::Node) + sizeof(std::uint32_t)) + sizeof(std::uint32_t) + 2 * 28) +
         (1 << 16);
}

}  // namespace rilievo::matching
