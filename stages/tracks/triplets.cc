// Loops of a triplet, their check, and the matches that are left.
#include "stages/tracks/triplets.h"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>

#include "base/check.h"
#include "base/rng.h"
#include "geometry/resection.h"
#include "geometry/triangulation.h"
#include "stages/tracks/same_position.h"

namespace rilievo::tracks {
namespace {

/// Features of two images, in the order of a triplet.
using Edge = std::pair<std::uint32_t, std::uint32_t>;
/// Features of the three images of a triplet, each matched with both others.
using Loop = std::array<std::uint32_t, 3>;
/// Places in a triplet of the two images of each of its pairs.
constexpr std::array<std::pair<std::size_t, std::size_t>, 3> kSides{{{0, 1}, {1, 2}, {0, 2}}};

/// The index of a pair, or none when it was not matched.
std::optional<std::size_t> FindPair(std::span<const TwoViewGeometry> pairs, ImageId a, ImageId b) {
  const ImagePair wanted{std::min(a, b), std::max(a, b)};
  const auto at =
      std::lower_bound(pairs.begin(), pairs.end(), wanted, [](const auto& g, const auto& p) { return g.pair < p; });
  if (at == pairs.end() || at->pair != wanted) return std::nullopt;
  return static_cast<std::size_t>(at - pairs.begin());
}

/// One side of a triplet: its pair, and the matches with representative features, sorted, in the triplet's direction.
struct Side {
  std::optional<std::size_t> pair;
  bool is_reversed = false;
  std::vector<Edge> edges;
};

template <class T>
void MakeUnique(std::vector<T>& values) {
  std::sort(values.begin(), values.end());
  values.erase(std::unique(values.begin(), values.end()), values.end());
}

class TripletChecker {
 public:
  TripletChecker(const SequenceInput& input, const Options& options, RunContext& context)
      : input_(input), options_(options), context_(context), used_(input.pairs.size()) {
    for (const auto& keypoints : input.keypoints) representatives_.push_back(RepresentativeFeatures(keypoints));
  }

  void Check(const Triplet& triplet) {
    context_.ThrowIfStopped();
    std::array<Side, 3> sides;
    for (std::size_t s = 0; s < 3; ++s) sides[s] = MakeSide(triplet[kSides[s].first], triplet[kSides[s].second]);
    const std::vector<Loop> rows = Rows(sides), loops = ClosedOnes(sides, rows);
    const auto widest = WidestSide(sides);
    const std::vector<Loop> kept = widest ? Confirmed(triplet, sides[*widest], *widest, loops) : loops;
    ++summary_.triplets;
    summary_.unchecked += !widest;
    summary_.loops += loops.size();
    if (kept.size() < kFewPoints) {
      ++summary_.weak;
      Use(sides, rows);
      return;
    }
    summary_.failed_loops += loops.size() - kept.size();
    Use(sides, kept);
  }

  SequenceMatches Finish() {
    UseAllMatchesOfPoorImages();
    SequenceMatches result;
    for (std::size_t p = 0; p < used_.size(); ++p) {
      if (input_.pairs[p].IsVerified()) summary_.matches += input_.pairs[p].inliers.size();
      MakeUnique(used_[p]);
      summary_.matches_used += used_[p].size();
      TwoViewGeometry geometry = WithoutMatches(input_.pairs[p]);
      geometry.inliers = std::move(used_[p]);
      result.pairs.push_back(std::move(geometry));
    }
    result.summary = summary_;
    return result;
  }

 private:
  static TwoViewGeometry WithoutMatches(const TwoViewGeometry& g) {
    return {g.pair, g.model,   g.reason,           g.second_from_first, g.matrix,
            {},     g.matches, g.median_angle_rad, g.homography_ratio};
  }

  Side MakeSide(ImageId from, ImageId to) const {
    Side side{FindPair(input_.pairs, from, to), to < from, {}};
    if (!side.pair || !input_.pairs[*side.pair].IsVerified()) return side;
    const auto &of_from = representatives_[from.value], &of_to = representatives_[to.value];
    for (const Match& match : input_.pairs[*side.pair].inliers)
      side.edges.push_back(side.is_reversed ? Edge{of_from[match.second], of_to[match.first]}
                                            : Edge{of_from[match.first], of_to[match.second]});
    MakeUnique(side.edges);
    return side;
  }

  /// Features matched in a row a - b - c, whether a - c are matched or not.
  static std::vector<Loop> Rows(const std::array<Side, 3>& sides) {
    std::vector<Loop> rows;
    const auto& bc = sides[1].edges;
    for (const auto& [a, b] : sides[0].edges)
      for (auto at = std::lower_bound(bc.begin(), bc.end(), Edge{b, 0}); at != bc.end() && at->first == b; ++at)
        rows.push_back({a, b, at->second});
    return rows;
  }

  static std::vector<Loop> ClosedOnes(const std::array<Side, 3>& sides, std::vector<Loop> rows) {
    const auto& ac = sides[2].edges;
    std::erase_if(rows, [&](const Loop& row) {
      return !std::binary_search(ac.begin(), ac.end(), Edge{row[0], row[2]});
    });
    return rows;
  }

  /// The side with the widest intersection angle among those whose relative orientation has a base.
  std::optional<std::size_t> WidestSide(const std::array<Side, 3>& sides) const {
    std::optional<std::size_t> widest;
    double angle_rad = -1;
    for (std::size_t s = 0; s < 3; ++s) {
      if (sides[s].edges.empty()) continue;
      const TwoViewGeometry& g = input_.pairs[*sides[s].pair];
      const bool has_base = g.model != TwoViewModel::kFundamental && g.second_from_first.translation.norm() > 0.5;
      if (has_base && g.median_angle_rad > angle_rad) widest = s, angle_rad = g.median_angle_rad;
    }
    return widest;
  }

  RayView View(const CameraPose& pose, ImageId image, const Eigen::Vector2d& normalized) const {
    return {&pose, normalized, input_.block.camera_of(image).model.MeanFocal()};
  }

  std::optional<Eigen::Vector2d> Normalized(ImageId image, std::uint32_t feature) const {
    return input_.block.camera_of(image).model.Normalize(input_.keypoints[image.value][feature].Position());
  }

  /// A loop with the object point of its two images of a side, and where the third image sees it.
  struct Intersected {
    std::vector<Loop> loops;
    std::vector<Eigen::Vector3d> points;
    std::vector<Eigen::Vector2d> in_third;
  };

  /// Loops without an object point that both images see where they should are left out.
  Intersected Intersect(const Triplet& triplet, const Side& side, std::size_t side_index,
                        std::span<const Loop> loops) const {
    const auto [from, to] = kSides[side_index];
    const std::size_t third = 3 - from - to;
    const Rigid3& pose = input_.pairs[*side.pair].second_from_first;
    const CameraPose first{Rigid3()}, second(side.is_reversed ? pose.Inverse() : pose);
    Intersected result;
    for (const Loop& loop : loops) {
      const auto in_first = Normalized(triplet[from], loop[from]), in_second = Normalized(triplet[to], loop[to]),
                 in_third = Normalized(triplet[third], loop[third]);
      if (!in_first || !in_second || !in_third) continue;
      const std::array<RayView, 2> views{View(first, triplet[from], *in_first), View(second, triplet[to], *in_second)};
      const auto start = IntersectRays(views);
      const auto point = start ? RefineIntersection(views, *start) : std::nullopt;
      const auto misses = [&](const RayView& view) {
        return RayResidualPx(view, *point) > options_.three_view_residual_px;
      };
      if (!point || std::any_of(views.begin(), views.end(), misses)) continue;
      result.loops.push_back(loop);
      result.points.push_back(*point);
      result.in_third.push_back(*in_third);
    }
    return result;
  }

  /// The loops whose object point, from the two images of `side`, the third image sees where it should.
  std::vector<Loop> Confirmed(const Triplet& triplet, const Side& side, std::size_t side_index,
                              std::span<const Loop> loops) const {
    const ImageId third = triplet[3 - kSides[side_index].first - kSides[side_index].second];
    const Intersected seen = Intersect(triplet, side, side_index, loops);
    ResectionOptions resection;
    resection.max_residual_px = options_.three_view_residual_px;
    resection.context = &context_;
    const auto found =
        EstimateResection({seen.points, seen.in_third, input_.block.camera_of(third).model.MeanFocal()}, resection,
                          SeedFor(context_.Seed(), triplet[0].value, triplet[1].value, triplet[2].value));
    std::vector<Loop> confirmed;
    if (!found) return confirmed;
    const CameraPose pose(found->cam_from_world);
    for (std::size_t i = 0; i < seen.loops.size(); ++i)
      if (RayResidualPx(View(pose, third, seen.in_third[i]), seen.points[i]) <= options_.three_view_residual_px)
        confirmed.push_back(seen.loops[i]);
    return confirmed;
  }

  void Use(const Side& side, const Edge& edge) {
    used_[*side.pair].push_back(side.is_reversed ? Match{edge.second, edge.first} : Match{edge.first, edge.second});
  }

  /// Of an open row only the two matches that are there.
  void Use(const std::array<Side, 3>& sides, std::span<const Loop> loops) {
    for (const Loop& loop : loops)
      for (std::size_t s = 0; s < 3; ++s) {
        const Edge edge{loop[kSides[s].first], loop[kSides[s].second]};
        if (s < 2 || std::binary_search(sides[s].edges.begin(), sides[s].edges.end(), edge)) Use(sides[s], edge);
      }
  }

  void UseAllMatchesOfPoorImages() {
    std::vector<std::vector<std::uint32_t>> features(input_.keypoints.size());
    for (std::size_t p = 0; p < used_.size(); ++p)
      for (const Match& match : used_[p]) {
        features[input_.pairs[p].pair.first.value].push_back(match.first);
        features[input_.pairs[p].pair.second.value].push_back(match.second);
      }
    std::vector<std::uint8_t> is_poor(features.size(), 0);
    for (const Triplet& triplet : input_.triplets)
      for (const ImageId image : triplet) {
        MakeUnique(features[image.value]);
        is_poor[image.value] = features[image.value].size() < kFewPoints;
      }
    summary_.poor_images = static_cast<std::uint64_t>(std::count(is_poor.begin(), is_poor.end(), std::uint8_t{1}));
    for (const Triplet& triplet : input_.triplets)
      for (const auto& [a, b] : kSides) {
        if (is_poor[triplet[a].value] == 0 && is_poor[triplet[b].value] == 0) continue;
        const Side side = MakeSide(triplet[a], triplet[b]);
        for (const Edge& edge : side.edges) Use(side, edge);
      }
  }

  const SequenceInput& input_;
  const Options& options_;
  RunContext& context_;
  std::vector<std::vector<std::uint32_t>> representatives_;  ///< by image, then feature
  std::vector<std::vector<Match>> used_;                     ///< by pair
  TripletSummary summary_;
};

}  // namespace

std::vector<Triplet> SequenceTriplets(std::size_t image_count, bool closed) {
  const auto n = static_cast<std::uint32_t>(image_count);
  std::vector<Triplet> triplets;
  for (std::uint32_t i = 0; i + 2 < n; ++i) triplets.push_back({ImageId(i), ImageId(i + 1), ImageId(i + 2)});
  if (closed && n >= 4) {
    triplets.push_back({ImageId(n - 2), ImageId(n - 1), ImageId(0)});
    triplets.push_back({ImageId(n - 1), ImageId(0), ImageId(1)});
  }
  return triplets;
}

SequenceMatches CheckTriplets(const SequenceInput& input, const Options& options, RunContext& context) {
  RILIEVO_CHECK(input.keypoints.size() == input.block.images.size());
  RILIEVO_CHECK(std::is_sorted(input.pairs.begin(), input.pairs.end(),
                               [](const auto& a, const auto& b) { return a.pair < b.pair; }));
  TripletChecker checker(input, options, context);
  for (const Triplet& triplet : input.triplets) checker.Check(triplet);
  return checker.Finish();
}

}  // namespace rilievo::tracks
