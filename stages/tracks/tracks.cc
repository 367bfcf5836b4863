// Concatenates verified matches into tracks: union-find that refuses two features of one image in one track.
#include "stages/tracks/tracks.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <numeric>
#include <utility>

#include "base/check.h"

namespace rilievo::tracks {
namespace {

constexpr std::size_t kMatchesBetweenPolls = 1 << 16;

/// Verified pairs, strongest first. The comparison is total up to equal content, so the order of the input is
/// forgotten.
std::vector<const TwoViewGeometry*> PairsByDescendingSupport(std::span<const TwoViewGeometry> pairs) {
  std::vector<const TwoViewGeometry*> order;
  for (const auto& pair : pairs) {
    if (!pair.IsVerified() || pair.inliers.empty()) continue;
    RILIEVO_CHECK(pair.pair.first < pair.pair.second && pair.pair.second.IsValid());
    order.push_back(&pair);
  }
  std::sort(order.begin(), order.end(), [](const TwoViewGeometry* a, const TwoViewGeometry* b) {
    if (a->inliers.size() != b->inliers.size()) return a->inliers.size() > b->inliers.size();
    if (a->pair != b->pair) return a->pair < b->pair;
    return a->inliers < b->inliers;
  });
  return order;
}

/// The features that occur in matches, numbered in the order (image, feature): node = position in `features`.
class Nodes {
 public:
  explicit Nodes(const std::vector<const TwoViewGeometry*>& pairs) {
    std::uint32_t images = 0;
    for (const auto* p : pairs) images = std::max(images, p->pair.second.value + 1);
    first_node_.assign(images + std::size_t{1}, 0);
    for (const auto* p : pairs) {
      first_node_[p->pair.first.value + 1] += p->inliers.size();
      first_node_[p->pair.second.value + 1] += p->inliers.size();
    }
    std::partial_sum(first_node_.begin(), first_node_.end(), first_node_.begin());
    features_.resize(first_node_.back());
    std::vector<std::size_t> next(first_node_.begin(), first_node_.end() - 1);
    for (const auto* p : pairs) {
      for (const Match& m : p->inliers) {
        features_[next[p->pair.first.value]++] = m.first;
        features_[next[p->pair.second.value]++] = m.second;
      }
    }
    DropRepetitions();
  }

  std::size_t Count() const { return features_.size(); }
  std::size_t Images() const { return first_node_.size() - 1; }
  std::uint32_t Feature(std::size_t node) const { return features_[node]; }
  std::size_t FirstNode(std::size_t image) const { return first_node_[image]; }
  std::uint32_t Find(ImageId image, std::uint32_t feature) const {
    const auto begin = features_.begin() + static_cast<std::ptrdiff_t>(first_node_[image.value]);
    const auto end = features_.begin() + static_cast<std::ptrdiff_t>(first_node_[image.value + 1]);
    return static_cast<std::uint32_t>(std::lower_bound(begin, end, feature) - features_.begin());
  }

 private:
  void DropRepetitions() {
    std::size_t kept = 0;
    for (std::size_t image = 0; image + 1 < first_node_.size(); ++image) {
      const auto begin = features_.begin() + static_cast<std::ptrdiff_t>(first_node_[image]);
      const auto end = features_.begin() + static_cast<std::ptrdiff_t>(first_node_[image + 1]);
      std::sort(begin, end);
      const auto unique_end = std::unique(begin, end);
      first_node_[image] = kept;
      std::copy(begin, unique_end, features_.begin() + static_cast<std::ptrdiff_t>(kept));
      kept += static_cast<std::size_t>(unique_end - begin);
    }
    first_node_.back() = kept;
    features_.resize(kept);
  }

  std::vector<std::size_t> first_node_;  ///< by image; one more entry for the end
  std::vector<std::uint32_t> features_;
};

/// Disjoint sets whose members are also strung on a ring, so that the images of a set can be listed before a merge.
class Components {
 public:
  explicit Components(const Nodes& nodes) : members_(nodes.Count()), seen_(nodes.Images(), 0) {
    for (std::uint32_t image = 0; image < nodes.Images(); ++image) {
      for (std::size_t node = nodes.FirstNode(image); node < nodes.FirstNode(image + std::size_t{1}); ++node) {
        const auto self = static_cast<std::uint32_t>(node);
        members_[node] = {.images_mod_64 = std::uint64_t{1} << (image % 64),
                          .parent = self,
                          .next = self,
                          .size = 1,
                          .image = image,
                          .list = kNoList};
      }
    }
  }

  std::uint32_t Root(std::uint32_t node) {
    while (members_[node].parent != node) node = members_[node].parent = members_[members_[node].parent].parent;
    return node;
  }

  std::uint32_t Size(std::uint32_t root) const { return members_[root].size; }
  std::uint32_t Image(std::size_t node) const { return members_[node].image; }

  /// Merges the sets of two nodes unless both hold a feature of one image. Cost: the sizes of the two sets when images
  /// of theirs agree modulo 64, else constant.
  void MergeUnlessConflict(std::uint32_t a, std::uint32_t b) {
    a = Root(a);
    b = Root(b);
    if (a == b) return;
    if (members_[a].size < members_[b].size) std::swap(a, b);
    if (ShareAnImage(a, b)) return;
    MergeLists(a, b);
    members_[b].parent = a;
    members_[a].size += members_[b].size;
    members_[a].images_mod_64 |= members_[b].images_mod_64;
    std::swap(members_[a].next, members_[b].next);
  }

 private:
  struct Member {                 // together, because a step along a ring or to a root is one cache miss
    std::uint64_t images_mod_64;  ///< of a root: bit i is set if the set has an image with number i modulo 64
    std::uint32_t parent, next, size, image, list;
  };

  /// Images along the ring of a node, in no particular order.
  std::vector<std::uint32_t> ImagesOnRing(std::uint32_t start) const {
    std::vector<std::uint32_t> images;
    std::uint32_t node = start;
    do {
      images.push_back(members_[node].image);
      node = members_[node].next;
    } while (node != start);
    return images;
  }

  /// Before the rings of two roots are joined: keeps the sorted images of sets that are, or now become, large.
  void MergeLists(std::uint32_t a, std::uint32_t b) {
    if (members_[a].size + members_[b].size <= kLargeSet) return;
    if (members_[a].list == kNoList) {
      members_[a].list = static_cast<std::uint32_t>(lists_.size());
      lists_.push_back(ImagesOnRing(a));
      std::sort(lists_.back().begin(), lists_.back().end());
    }
    std::vector<std::uint32_t>& images = lists_[members_[a].list];
    std::vector<std::uint32_t> added;
    if (members_[b].list == kNoList) {
      added = ImagesOnRing(b);
      std::sort(added.begin(), added.end());
    } else {
      added.swap(lists_[members_[b].list]);
    }
    const auto middle = static_cast<std::ptrdiff_t>(images.size());
    images.insert(images.end(), added.begin(), added.end());
    std::inplace_merge(images.begin(), images.begin() + middle, images.end());
  }

  /// `a` is the larger set.
  bool ShareAnImage(std::uint32_t a, std::uint32_t b) {
    if ((members_[a].images_mod_64 & members_[b].images_mod_64) == 0) return false;
    if (members_[a].list == kNoList) return ShareAnImageOnRings(a, b);
    const std::vector<std::uint32_t>& images = lists_[members_[a].list];
    const std::vector<std::uint32_t> others =
        members_[b].list == kNoList ? ImagesOnRing(b) : std::vector<std::uint32_t>{};
    const std::vector<std::uint32_t>& few = members_[b].list == kNoList ? others : lists_[members_[b].list];
    return std::any_of(few.begin(), few.end(),
                       [&](std::uint32_t image) { return std::binary_search(images.begin(), images.end(), image); });
  }

  bool ShareAnImageOnRings(std::uint32_t a, std::uint32_t b) {
    ++stamp_;
    std::uint32_t node = b;
    do {
      seen_[members_[node].image] = stamp_;
      node = members_[node].next;
    } while (node != b);
    node = a;
    do {
      if (seen_[members_[node].image] == stamp_) return true;
      node = members_[node].next;
    } while (node != a);
    return false;
  }

  /// Sets beyond this size keep their images in a list: walking their rings would be a cache miss for every member.
  static constexpr std::uint32_t kLargeSet = 16;
  static constexpr std::uint32_t kNoList = 0xffffffffU;
  std::vector<std::vector<std::uint32_t>> lists_;  ///< sorted images of the large sets
  std::vector<Member> members_;
  std::vector<std::uint64_t> seen_;  ///< by image: the last test that met it
  std::uint64_t stamp_ = 0;
};

/// Nodes ascend in (image, feature), so tracks come out sorted by their first element and elements by image.
std::vector<Track> Collect(const Nodes& nodes, Components& components) {
  constexpr std::uint32_t kNoTrack = 0xffffffffU;
  std::vector<std::uint32_t> track_of_root(nodes.Count(), kNoTrack);
  std::size_t count = 0;
  for (std::uint32_t node = 0; node < nodes.Count(); ++node) {
    count += components.Root(node) == node && components.Size(node) >= 2 ? 1 : 0;
  }
  std::vector<Track> tracks;
  tracks.reserve(count);
  for (std::uint32_t node = 0; node < nodes.Count(); ++node) {
    const std::uint32_t root = components.Root(node);
    if (components.Size(root) < 2) continue;
    if (track_of_root[root] == kNoTrack) {
      track_of_root[root] = static_cast<std::uint32_t>(tracks.size());
      tracks.emplace_back().elements.reserve(components.Size(root));
    }
    tracks[track_of_root[root]].elements.push_back({ImageId(components.Image(node)), nodes.Feature(node)});
  }
  return tracks;
}

}  // namespace

std::span<const OptionDeclaration<Options>> OptionDeclarations() {
  static const std::array<OptionDeclaration<Options>, 4> kDeclarations{{
      {"closed-sequence", &Options::closed_sequence, 0, 0, "",
       "the last images of a sequence overlap the first: triplets across its end too"},
      {"three-view-residual", &Options::three_view_residual_px, 0.1, 100, "px",
       "sequence: largest residual of a tie point in the third image of its triplet"},
      {"reduce", &Options::reduce, 0, 0, "",
       "keep only the tie points of most rays, one a grid cell of each image (leaner adjustment)"},
      {"reduction-cell", &Options::reduction_cell_px, 0, 100000, "px",
       "width of a grid cell, three quarters of it high; 0 = 200 px at 12 Mpx, by the root of the image size"},
  }};
  return kDeclarations;
}

TaskCost Estimate(std::size_t matches_in_all, std::size_t features_in_all) {
  // A match brings two features of 4 bytes, repetitions before they are dropped included. Each different one makes a
  // node (sets 32, image lists 12, track number 4, element 8), two nodes make at most one track (vector 24, head of its
  // block 16).
  constexpr std::uint64_t kBytesPerNode = 32 + 12 + 4 + 8;
  constexpr std::uint64_t kBytesPerTrack = 24 + 16;
  const auto matches = static_cast<std::uint64_t>(matches_in_all), repeated = 2 * matches;
  const std::uint64_t nodes = std::min<std::uint64_t>(repeated, features_in_all);
  const std::uint64_t concatenation = repeated * 4 + nodes * (kBytesPerNode + kBytesPerTrack / 2);
  // Triplets: an image of a sequence is in at most four pairs, so matches are at most twice the features. A match is
  // used by two triplets (8 bytes, twice while the vector grows) and brings two features to count (4 bytes, as well).
  // Every feature has its representative (4); the larger number of features is not known where nodes bound it.
  const std::uint64_t triplets = std::min(matches, 2 * nodes) * (2 * 2 * 8 + 2 * 2 * 4) + 8 * nodes;
  // The reduction: all tracks and those kept (element 8), of a ray its cell and its track's rank (4, in vectors that
  // grow), of a track its score and order (24).
  const std::uint64_t reduction = nodes * (8 + 8 + 2 * (4 + 4)) + nodes / 2 * (2 * kBytesPerTrack + 24);
  return {.peak_bytes = (1 << 20) + triplets + std::max(concatenation, reduction),
          .work = 1.6e-6 * static_cast<double>(matches_in_all)};
}

std::vector<Track> Run(std::span<const TwoViewGeometry> pairs, RunContext& context) {
  const auto order = PairsByDescendingSupport(pairs);
  const Nodes nodes(order);
  Components components(nodes);
  std::size_t since_poll = 0;
  for (const TwoViewGeometry* pair : order) {
    for (const Match& match : pair->inliers) {
      if (++since_poll == kMatchesBetweenPolls) {
        context.ThrowIfStopped();
        since_poll = 0;
      }
      components.MergeUnlessConflict(nodes.Find(pair->pair.first, match.first),
                                     nodes.Find(pair->pair.second, match.second));
    }
  }
  return Collect(nodes, components);
}

}  // namespace rilievo::tracks
