// Randomised k-d trees over descriptors, and the best-bin-first search in them.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "block/features.h"
#include "stages/matching/distance_kernels.h"
#include "stages/matching/matching_kernels.h"

namespace rilievo::matching {

/// Trees that split at the mean of one byte of the descriptors. A single tree takes the byte of greatest variance, of
/// several each takes one of the five greatest at random (Silpa-Anan & Hartley, CVPR 2008). The trees are a pure
/// function of the descriptors: their random numbers are keyed by tree and node.
class KdForest {
 public:
  /// Keeps a view of `points` (fewer than 2^32). Cost about |points| log |points| descriptors read a tree.
  KdForest(std::span<const Descriptor> points, int trees);

  /// An inner node's first child is the next node. Bytes below `split` are there, the others in `second`.
  struct Node {
    std::uint32_t second = 0;          ///< the other child; of a leaf: the end of its points
    std::uint32_t begin = 0;           ///< of a leaf's points
    std::uint8_t dimension = kNoByte;  ///< kNoByte: a leaf
    std::uint8_t split = 0;
    bool IsLeaf() const { return dimension == kNoByte; }
  };
  static constexpr std::uint8_t kNoByte = 0xff;

  std::span<const Descriptor> points() const { return points_; }
  std::span<const Node> nodes() const { return nodes_; }
  std::span<const std::uint32_t> roots() const { return roots_; }
  /// Indices of points, a permutation a tree; leaves are ranges of it.
  std::span<const std::uint32_t> order() const { return order_; }

 private:
  void AddTree(std::size_t tree, std::size_t trees);

  std::span<const Descriptor> points_;
  std::vector<Node> nodes_;
  std::vector<std::uint32_t> roots_, order_;
};

/// Best-bin-first search (Beis & Lowe, CVPR 1997) in all trees at once: the branch whose cell is nearest comes next.
/// The bound of a branch is the exact squared distance of its cell in the bytes split so far (Arya & Mount 1993), so a
/// search without limit ends with the true neighbours. One object serves many queries, one after the other.
class KdSearch {
 public:
  explicit KdSearch(const KdForest& forest, DistanceKernel distances);

  /// The two nearest of the points compared. No leaf is begun once `checks` points were compared (0: no limit, exact).
  BestTwo Find(const Descriptor& query, std::size_t checks);

 private:
  /// The side of a split that was not taken. Its cell differs from that of `parent` by the distance in one byte.
  struct Branch {
    std::uint32_t node, parent;
    std::int32_t bound_sq;
    std::int32_t offset_sq;
    std::uint8_t dimension;
  };
  struct HeapEntry {
    std::int32_t bound_sq;
    std::uint32_t branch;
  };

  void Push(const Branch& branch);
  std::uint32_t Pop();
  std::int32_t OffsetSq(std::uint32_t branch, std::uint8_t dimension) const;
  std::uint32_t Descend(const Descriptor& query, std::uint32_t branch);
  std::size_t CompareLeaf(const Descriptor& query, const KdForest::Node& leaf, BestTwo& best);

  const KdForest& forest_;
  DistanceKernel distances_;
  std::vector<Branch> branches_;
  std::vector<HeapEntry> heap_;
  std::vector<std::uint32_t> stamps_;  ///< the last query that saw a point
  std::uint32_t stamp_ = 0;
  std::vector<std::uint32_t> fresh_;
  std::vector<std::int32_t> fresh_sq_;
};

/// Upper bound of the bytes of a forest and one search in it.
std::size_t KdForestBytes(std::size_t points, int trees);

}  // namespace rilievo::matching
