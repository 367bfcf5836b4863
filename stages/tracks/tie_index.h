// Tie points ordered by worth, with the grid cells that they occupy and the images that they link.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "block/block.h"
#include "block/features.h"
#include "block/pair.h"
#include "block/tie_summary.h"
#include "block/track.h"

namespace rilievo::tracks {

/// Two images are linked by this many common tie points, and reduction leaves a strong pair so many (SPEC 3).
inline constexpr std::size_t kCommonPoints = 10;
/// Links that reduction leaves every image (SPEC 3).
inline constexpr std::size_t kLinksPerImage = 5;
/// Verified matches of a strong pair: the strict bar of a resection.
inline constexpr std::size_t kStrongPair = 30;

struct TieInput {
  const Block& block;
  std::span<const std::vector<Keypoint>> keypoints;  ///< by image id
  std::span<const TwoViewGeometry> pairs;            ///< verified and rejected
  std::span<const Track> tracks;
};

/// Regular grids over all images, cells numbered through: image after image, row after row.
class CellGrids {
 public:
  /// Cells `cell_px` wide and three quarters of it high; 0 = 200 px wide at 12 Mpx, by the root of the image size.
  CellGrids(const Block& block, double cell_px);
  std::size_t Count() const { return count_; }
  /// A position outside the image counts for the cell at its border.
  std::uint32_t CellOf(ImageId image, const Eigen::Vector2d& position_px) const;

 private:
  struct Grid {
    double width_px, height_px;
    std::uint32_t columns, rows, first;
  };
  std::vector<Grid> grids_;  ///< by image
  std::size_t count_ = 0;
};

/// Ranks run over the tracks from the most worthy: more rays, then smaller mean sigma of detection, then the elements
/// (each track has its own: the order is total, and forgets that of the input).
class TieIndex {
 public:
  /// `input` must outlive it. O(rays log tracks).
  TieIndex(const TieInput& input, double cell_px);

  std::size_t Count() const { return track_of_rank_.size(); }
  const Track& track(std::size_t rank) const { return input_.tracks[track_of_rank_[rank]]; }
  /// Cells of the track's rays.
  std::span<const std::uint32_t> Cells(std::size_t rank) const;
  std::size_t CellCount() const { return grids_.Count(); }
  /// Ranks of the tracks that have a ray in both images, ascending. O(tracks of the two images).
  std::vector<std::uint32_t> Common(const ImagePair& pair) const;
  /// The tracks of a rank for which `is_used` is not zero. O(rays + tracks of both images of every verified pair).
  TieSetSummary Measure(std::span<const std::uint8_t> is_used) const;

 private:
  const TieInput& input_;
  CellGrids grids_;
  std::vector<std::uint32_t> track_of_rank_;
  std::vector<std::uint32_t> first_cell_, cells_;           ///< by rank; one more entry for the end
  std::vector<std::vector<std::uint32_t>> ranks_of_image_;  ///< ascending
};

}  // namespace rilievo::tracks
