// FAST cell row by cell row in strips of whole cells; the threshold of a cell from the sorted scores of its corners.
#include "stages/features/fast.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <tuple>

#include "base/check.h"
#include "stages/features/fast_kernels.h"
#include "stages/features/kernel_choice.h"

namespace rilievo::features {
namespace {

constexpr int kRadius_px = 3;
constexpr int kLargestBits = 15;  ///< differences of pixels are 16-bit integers

/// Pixels as they are compared: 16-bit images lose the bits that their brightest pixel uses beyond 15.
struct Levels {
  int shift = 0;
  double unit = 1;  ///< grey levels of 255, of one compared level
};

Levels LevelsOf(const GreyImage& image) {
  if (!image.Is16Bit()) return {};
  const unsigned brightest = *std::max_element(image.u16.begin(), image.u16.end());
  const int bits = std::bit_width(brightest), kept = std::min(bits, kLargestBits);
  return {.shift = bits - kept, .unit = 1.0 / (1 << std::max(kept - 8, 0))};
}

struct Candidate {
  int score = 0, x = 0, y = 0;
};

struct Area {
  int x_begin = 0, x_end = 0, y_begin = 0, y_end = 0;
};

/// One strip after the other: the rows that they share.
class FastRunner {
 public:
  FastRunner(const Input& input, const FastOptions& options, const FastKernels& kernels, int strip_px)
      : image_(input.image),
        mask_(input.mask),
        options_(options),
        kernels_(kernels),
        levels_(LevelsOf(image_)),
        // score > floor: the largest threshold, score - 1, is not below min_threshold.
        floor_(static_cast<std::int16_t>(
            std::clamp(std::ceil(options.min_threshold / levels_.unit), 0.0, static_cast<double>(INT16_MAX)))),
        halo_px_(std::max(kRadius_px + 1, options.roundness_window_px / 2 + 1)),
        border_px_(std::max(kRadius_px, options.roundness_window_px / 2 + 1)),
        stride_(static_cast<std::size_t>(strip_px + 2 * halo_px_ + fast::kOvershoot)),
        pixels_(stride_ * static_cast<std::size_t>(kFastCell_px + 2 * halo_px_), 0) {
    for (auto& row : scores_) row.assign(stride_, 0);
    columns_.assign(stride_, 0);
    cells_.resize(static_cast<std::size_t>(strip_px / kFastCell_px + 1));
  }

  /// Appends the corners of one strip of one row of cells.
  void Run(const Area& area, std::vector<Corner>& found) {
    area_ = area;
    FillPixels();
    for (auto& cell : cells_) cell.clear();
    for (int y = area.y_begin - 1; y <= area.y_end; ++y) {
      Score(y);
      if (y > area.y_begin) Collect(y - 1);
    }
    for (std::size_t i = 0; i < cells_.size(); ++i) {
      const int x = area.x_begin + static_cast<int>(i) * kFastCell_px;
      if (x < area.x_end)
        Select(cells_[i], std::min(kFastCell_px, area.x_end - x) * (area.y_end - area.y_begin), found);
    }
  }

 private:
  /// Pixel (x, y) of the image, at most halo_px_ outside of the area.
  const std::int16_t* At(int x, int y) const {
    return pixels_.data() + static_cast<std::size_t>(y - area_.y_begin + halo_px_) * stride_ +
           (x - area_.x_begin + halo_px_);
  }

  void FillPixels() {
    const int x_begin = std::max(0, area_.x_begin - halo_px_),
              x_end = std::min(image_.width_px, area_.x_end + halo_px_);
    const int y_begin = std::max(0, area_.y_begin - halo_px_),
              y_end = std::min(image_.height_px, area_.y_end + halo_px_);
    for (int y = y_begin; y < y_end; ++y) {
      auto* out = const_cast<std::int16_t*>(At(x_begin, y));
      const auto row = static_cast<std::size_t>(y) * static_cast<std::size_t>(image_.width_px);
      const int shift = levels_.shift;
      const auto copy = [&](const auto* from) {
        for (int x = x_begin; x < x_end; ++x) out[x - x_begin] = static_cast<std::int16_t>(from[x] >> shift);
      };
      if (image_.Is16Bit()) {
        copy(image_.u16.data() + row);
      } else {
        copy(image_.u8.data() + row);
      }
    }
  }

  /// Element 0 is column x_begin - 1 of the area.
  std::int16_t* ScoresOf(int y) { return scores_[(y + 3) % 3].data(); }

  void Score(int y) {
    std::int16_t* out = ScoresOf(y);
    const int first = area_.x_begin - 1, begin = std::max(first, kRadius_px),
              end = std::min(area_.x_end + 1, image_.width_px - kRadius_px);
    std::fill_n(out, area_.x_end + 1 - first, floor_);
    if (y < kRadius_px || y >= image_.height_px - kRadius_px || begin >= end) return;
    fast::ScoreRow row{};
    for (int j = 0; j < 7; ++j) row.rows[j] = At(begin, y + j - kRadius_px);
    row.count = end - begin;
    row.arc = options_.arc;
    row.floor = floor_;
    row.out = out + (begin - first);
    kernels_.scores(row);
    // The kernel works in whole vectors; what lies beyond the image's last score is none.
    std::fill(out + (end - first), out + (area_.x_end + 1 - first), floor_);
  }

  void Collect(int y) {
    const int begin = std::max(area_.x_begin, border_px_), end = std::min(area_.x_end, image_.width_px - border_px_);
    if (y < border_px_ || y >= image_.height_px - border_px_ || begin >= end) return;
    fast::MaximaRow row{};
    for (int j = 0; j < 3; ++j) row.rows[j] = ScoresOf(y + j - 1) + (begin - area_.x_begin + 1);
    row.count = end - begin;
    row.floor = floor_;
    const int count = kernels_.maxima(row, columns_.data());
    for (int i = 0; i < count; ++i) {
      const int column = columns_[static_cast<std::size_t>(i)], x = begin + column;
      const auto pixel =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(image_.width_px) + static_cast<std::size_t>(x);
      if (!mask_.empty() && mask_[pixel] < 128) continue;
      cells_[static_cast<std::size_t>((x - area_.x_begin) / kFastCell_px)].push_back({row.rows[1][column] - 1, x, y});
    }
  }

  /// Foerstner & Guelch 1987, equation for q: 1 for a round error ellipse, 0 for an edge.
  double Roundness(int x, int y) const {
    const int half = options_.roundness_window_px / 2;
    std::int64_t xx = 0, xy = 0, yy = 0;
    for (int j = y - half; j <= y + half; ++j) {
      const std::int16_t *row = At(x, j), *above = At(x, j - 1), *below = At(x, j + 1);
      for (int i = -half; i <= half; ++i) {
        const std::int64_t gx = row[i + 1] - row[i - 1], gy = below[i] - above[i];
        xx += gx * gx;
        xy += gx * gy;
        yy += gy * gy;
      }
    }
    const auto a = static_cast<double>(xx), b = static_cast<double>(xy), c = static_cast<double>(yy);
    return a + c > 0 ? 4 * (a * c - b * b) / ((a + c) * (a + c)) : 0;
  }

  /// Strongest first, until the cell has its share; all of one score together.
  void Select(std::vector<Candidate>& cell, int pixels, std::vector<Corner>& found) const {
    const auto image_pixels = static_cast<std::int64_t>(image_.width_px) * image_.height_px;
    const auto share = static_cast<std::size_t>(
        (static_cast<std::int64_t>(options_.corners) * pixels + image_pixels - 1) / image_pixels);
    std::sort(cell.begin(), cell.end(), [](const Candidate& a, const Candidate& b) {
      return std::tie(b.score, a.y, a.x) < std::tie(a.score, b.y, b.x);
    });
    std::size_t kept = 0;
    int last_score = 0;
    for (const Candidate& c : cell) {
      if (kept >= share && c.score != last_score) break;
      const double q = Roundness(c.x, c.y);
      if (q < options_.min_roundness) continue;
      ++kept;
      last_score = c.score;
      found.push_back({.x_px = static_cast<float>(c.x) + 0.5F,
                       .y_px = static_cast<float>(c.y) + 0.5F,
                       .score = static_cast<float>(c.score * levels_.unit),
                       .roundness = static_cast<float>(q)});
    }
  }

  const GreyImage& image_;
  const std::span<const std::uint8_t> mask_;
  const FastOptions& options_;
  const FastKernels& kernels_;
  const Levels levels_;
  const std::int16_t floor_;
  const int halo_px_, border_px_;
  const std::size_t stride_;
  Area area_;
  std::vector<std::int16_t> pixels_;
  std::vector<std::int16_t> scores_[3];
  std::vector<std::int32_t> columns_;
  std::vector<std::vector<Candidate>> cells_;
};

const FastKernels& ProcessKernels() {
  static const FastKernels& kernels = ChooseFastKernels(ForcedKernels());
  return kernels;
}

}  // namespace

std::vector<Corner> DetectFast(const Input& input, const FastOptions& options, const Tiling& tiling,
                               RunContext& context) {
  return DetectFast(input, options, tiling, context, ProcessKernels());
}

std::vector<Corner> DetectFast(const Input& input, const FastOptions& options, const Tiling& tiling,
                               RunContext& context, const FastKernels& kernels) {
  const GreyImage& image = input.image;
  const auto pixels = static_cast<std::size_t>(image.width_px) * static_cast<std::size_t>(image.height_px);
  RILIEVO_CHECK(options.arc == 9 || options.arc == 12);
  RILIEVO_CHECK(options.roundness_window_px % 2 == 1);
  RILIEVO_CHECK((image.Is16Bit() ? image.u16.size() : image.u8.size()) == pixels);
  RILIEVO_CHECK(input.mask.empty() || input.mask.size() == pixels);
  context.ThrowIfStopped();
  if (pixels == 0) return {};
  const int strip_px =
      std::clamp(tiling.strip_width_px, kFastCell_px, image.width_px + kFastCell_px - 1) / kFastCell_px * kFastCell_px;
  const auto strips = static_cast<std::size_t>((image.width_px + strip_px - 1) / strip_px);
  const std::size_t chunks = std::min(strips, static_cast<std::size_t>(std::max(tiling.chunks, 1)));
  std::vector<std::vector<Corner>> found(chunks);
  context.ParallelFor(chunks, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t chunk = begin; chunk < end; ++chunk) {
      FastRunner runner(input, options, kernels, strip_px);
      for (std::size_t strip = chunk * strips / chunks; strip < (chunk + 1) * strips / chunks; ++strip) {
        const int x = static_cast<int>(strip) * strip_px;
        for (int y = 0; y < image.height_px; y += kFastCell_px) {
          context.ThrowIfStopped();
          runner.Run({.x_begin = x,
                      .x_end = std::min(x + strip_px, image.width_px),
                      .y_begin = y,
                      .y_end = std::min(y + kFastCell_px, image.height_px)},
                     found[chunk]);
        }
      }
    }
  });
  std::vector<Corner> all;
  for (const auto& part : found) all.insert(all.end(), part.begin(), part.end());
  std::sort(all.begin(), all.end(),
            [](const Corner& a, const Corner& b) { return std::tie(a.y_px, a.x_px) < std::tie(b.y_px, b.x_px); });
  return all;
}

}  // namespace rilievo::features
