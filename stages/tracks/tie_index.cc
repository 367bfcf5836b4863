// Cells, ranks and links of tie points.
#include "stages/tracks/tie_index.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <tuple>

#include "base/check.h"

namespace rilievo::tracks {
namespace {

double MeanScale_px(const Track& track, std::span<const std::vector<Keypoint>> keypoints) {
  double sum = 0;
  for (const FeatureRef& e : track.elements) sum += keypoints[e.image.value][e.feature].scale_px;
  return sum / static_cast<double>(track.elements.size());
}

/// Groups of images that links hold together.
class Groups {
 public:
  explicit Groups(std::size_t images) : parent_(images) { std::iota(parent_.begin(), parent_.end(), 0U); }
  void Join(ImageId a, ImageId b) { parent_[Root(a.value)] = Root(b.value); }
  std::uint32_t Root(std::uint32_t image) const {
    while (parent_[image] != image) image = parent_[image];
    return image;
  }

 private:
  std::vector<std::uint32_t> parent_;
};

}  // namespace

CellGrids::CellGrids(const Block& block, double cell_px) {
  for (const Image& image : block.images) {
    const double pixels = static_cast<double>(image.width_px) * image.height_px;
    const double width_px = std::max(1.0, cell_px > 0 ? cell_px : 200 * std::sqrt(pixels / 12e6));
    const double height_px = std::max(1.0, 0.75 * width_px);
    const auto columns = static_cast<std::uint32_t>(std::max(1.0, std::ceil(image.width_px / width_px)));
    const auto rows = static_cast<std::uint32_t>(std::max(1.0, std::ceil(image.height_px / height_px)));
    grids_.push_back({width_px, height_px, columns, rows, static_cast<std::uint32_t>(count_)});
    count_ += static_cast<std::size_t>(columns) * rows;
  }
  RILIEVO_CHECK(count_ <= std::numeric_limits<std::uint32_t>::max());
}

std::uint32_t CellGrids::CellOf(ImageId image, const Eigen::Vector2d& position_px) const {
  const Grid& g = grids_[image.value];
  const auto index = [](double position, double cell, std::uint32_t cells) {
    return static_cast<std::uint32_t>(std::clamp(position / cell, 0.0, static_cast<double>(cells - 1)));
  };
  return g.first + index(position_px.y(), g.height_px, g.rows) * g.columns +
         index(position_px.x(), g.width_px, g.columns);
}

TieIndex::TieIndex(const TieInput& input, double cell_px) : input_(input), grids_(input.block, cell_px) {
  std::vector<double> scale_px;
  for (const Track& track : input.tracks) scale_px.push_back(MeanScale_px(track, input.keypoints));
  track_of_rank_.resize(input.tracks.size());
  std::iota(track_of_rank_.begin(), track_of_rank_.end(), 0U);
  std::sort(track_of_rank_.begin(), track_of_rank_.end(), [&](std::uint32_t a, std::uint32_t b) {
    const auto &first = input.tracks[a].elements, &second = input.tracks[b].elements;
    if (first.size() != second.size()) return first.size() > second.size();
    if (scale_px[a] != scale_px[b]) return scale_px[a] < scale_px[b];
    return first < second;
  });
  ranks_of_image_.resize(input.block.images.size());
  first_cell_.push_back(0);
  for (std::uint32_t rank = 0; rank < track_of_rank_.size(); ++rank) {
    for (const FeatureRef& e : track(rank).elements) {
      cells_.push_back(grids_.CellOf(e.image, input.keypoints[e.image.value][e.feature].Position()));
      ranks_of_image_[e.image.value].push_back(rank);
    }
    first_cell_.push_back(static_cast<std::uint32_t>(cells_.size()));
  }
}

std::span<const std::uint32_t> TieIndex::Cells(std::size_t rank) const {
  return std::span(cells_).subspan(first_cell_[rank], first_cell_[rank + 1] - first_cell_[rank]);
}

std::vector<std::uint32_t> TieIndex::Common(const ImagePair& pair) const {
  const auto &a = ranks_of_image_[pair.first.value], &b = ranks_of_image_[pair.second.value];
  std::vector<std::uint32_t> common;
  std::set_intersection(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(common));
  return common;
}

TieSetSummary TieIndex::Measure(std::span<const std::uint8_t> is_used) const {
  RILIEVO_CHECK(is_used.size() == Count());
  TieSetSummary summary;
  std::vector<std::uint8_t> is_occupied(grids_.Count(), 0), has_points(ranks_of_image_.size(), 0);
  for (std::size_t rank = 0; rank < Count(); ++rank) {
    if (!is_used[rank]) continue;
    ++summary.points;
    summary.rays += track(rank).elements.size();
    for (const std::uint32_t cell : Cells(rank)) is_occupied[cell] = 1;
    for (const FeatureRef& e : track(rank).elements) has_points[e.image.value] = 1;
  }
  summary.cells = static_cast<std::uint64_t>(std::count(is_occupied.begin(), is_occupied.end(), std::uint8_t{1}));

  std::vector<std::uint64_t> links(ranks_of_image_.size(), 0);
  Groups groups(ranks_of_image_.size());
  std::uint64_t least_common = std::numeric_limits<std::uint64_t>::max();
  for (const TwoViewGeometry& g : input_.pairs) {
    if (!g.IsVerified()) continue;
    const auto ranks = Common(g.pair);
    const auto common = static_cast<std::uint64_t>(
        std::count_if(ranks.begin(), ranks.end(), [&](std::uint32_t rank) { return is_used[rank] != 0; }));
    if (g.inliers.size() >= kStrongPair) least_common = std::min(least_common, common);
    if (common < kCommonPoints) continue;
    ++summary.linked_pairs;
    ++links[g.pair.first.value];
    ++links[g.pair.second.value];
    groups.Join(g.pair.first, g.pair.second);
  }
  if (least_common != std::numeric_limits<std::uint64_t>::max()) summary.least_common = least_common;
  bool is_first = true;
  for (std::uint32_t i = 0; i < links.size(); ++i) {
    if (has_points[i])
      summary.least_links = is_first ? links[i] : std::min(summary.least_links, links[i]), is_first = false;
    if (links[i] > 0 && groups.Root(i) == i) ++summary.groups;
  }
  return summary;
}

}  // namespace rilievo::tracks
