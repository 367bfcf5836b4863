// SURF in strips that run down the image over a ring of rows of its integral image.
#include "stages/features/surf.h"

#include <algorithm>
#include <bit>
#include <memory>
#include <numbers>
#include <type_traits>

#include "base/check.h"
#include "stages/features/kernel_choice.h"
#include "stages/features/surf_feature.h"
#include "stages/features/surf_geometry.h"
#include "stages/features/surf_kernels.h"

namespace rilievo::features {
namespace {

using namespace surf;

/// Filters are evaluated this far beyond the columns of a strip: the coarsest sample on either side.
constexpr int kMargin_px = 1 << (kOctaves - 1);
constexpr int kMaskOfRing = kRingRows - 1;
/// Of summed pixels: differences of 195 x 129 boxes of them stay below 2^31.
constexpr int kBits = 12;

/// Half-sample reflection, however far outside: 2 1 0 | 0 1 2 .. n-1 | n-1 n-2.
int Reflect(int i, int n) {
  const int m = ((i % (2 * n)) + 2 * n) % (2 * n);
  return m < n ? m : 2 * n - 1 - m;
}

int RingStride(int width_px) {
  const int lines = (width_px + 2 * kReach_px + 1 + kOvershoot + 15) / 16;
  return 16 * (lines | 1);  // an odd number of cache lines: rows spread over all sets of a cache
}

/// Every 2^octave-th value; the steps are constants so that the compiler shuffles vectors.
void Decimate(const float* from, int octave, int count, float* to) {
  const auto copy = [&](auto step) {
    for (int i = 0; i < count; ++i) to[i] = from[step * i];
  };
  if (octave == 1) copy(std::integral_constant<int, 2>{});
  if (octave == 2) copy(std::integral_constant<int, 4>{});
  if (octave == 3) copy(std::integral_constant<int, 8>{});
  static_assert(kOctaves == 4);
}

/// 16-bit images are shifted to at most 12 bits by what their brightest pixel uses; then all are smoothed (weights of
/// sum 256) and shifted to 12 bits, 16 units a grey level of 255.
struct Levels {
  int shift_before = 0, shift_after = 8 + 8 - kBits;
};
constexpr double kLevelsPerUnit = 1.0 / (1 << (kBits - 8));

Levels LevelsOf(const GreyImage& image) {
  if (!image.Is16Bit()) return {};
  const int bits = std::bit_width(static_cast<unsigned>(*std::max_element(image.u16.begin(), image.u16.end())));
  const int kept = std::clamp(bits, 8, kBits);
  return {.shift_before = std::max(bits - kept, 0), .shift_after = kept + 8 - kBits};
}

/// Sampled rows of det H of one octave, the last three of each layer.
struct OctaveRows {
  int first = 0, end = 0;  ///< samples that the strip owns
  int lead = 1;            ///< values before the first one
  std::vector<float> rows[kLayers][3];
};

/// One strip after the other: the memory that they share and the way down the image.
class StripRunner {
 public:
  StripRunner(const GreyImage& image, const SurfOptions& options, const SurfKernels& kernels, int width_px)
      : image_(image), options_(options), kernels_(kernels), levels_(LevelsOf(image)), stride_(RingStride(width_px)) {
    ring_ = std::make_unique_for_overwrite<std::int32_t[]>(static_cast<std::size_t>(stride_) * kRingRows);
    line_.assign(static_cast<std::size_t>(stride_), 0);
    reflected_.assign(static_cast<std::size_t>(stride_), 0);
    const auto padded = static_cast<std::size_t>(width_px + 2 * kMargin_px + kOvershoot);
    for (auto& line : filter_lines_) line.assign(padded, 0);
    for (auto& octave : octaves_) {
      for (auto& layer : octave.rows) {
        for (auto& row : layer) row.assign(padded, 0);
      }
    }
    columns_.assign(padded, 0);
  }

  /// Appends the features whose discrete samples lie in columns [x_begin, x_end).
  void Run(int x_begin, int x_end, const RunContext& context, std::vector<Feature>& found) {
    x_begin_ = x_begin;
    width_ = x_end - x_begin;
    for (int o = 0; o < kOctaves; ++o) {
      const int step = 1 << o;
      octaves_[o].first = (x_begin + step - 1) >> o;
      octaves_[o].end = (x_end + step - 1) >> o;
      octaves_[o].lead = o == 0 ? kMargin_px : 1;
    }
    for (int i = 0; i < LineLength(); ++i) {
      reflected_[static_cast<std::size_t>(i)] = Reflect(x_begin - kReach_px - 2 + i, image_.width_px);
    }
    std::fill_n(Row(-kReach_px), stride_, 0);
    front_ = -kReach_px;
    for (int y = 0; y < image_.height_px; ++y) {
      if (y % 64 == 0) context.ThrowIfStopped();
      while (front_ < y + kReach_px) AddRow();
      Filters(y);
      for (int o = 0; o < kOctaves && y % (1 << o) == 0; ++o) Search(o, (y >> o) - 1, found);
    }
  }

 private:
  /// Boundary row y of the ring; its element 0 is boundary column x_begin - kReach_px.
  std::int32_t* Row(int y) {
    return ring_.get() + static_cast<std::size_t>(y & kMaskOfRing) * static_cast<std::size_t>(stride_);
  }

  /// One row of the image smoothed down its columns, from two columns before the ring's first to two after its last:
  /// binomial weights 1 4 6 4 1 of sum 16.
  template <class Pixel>
  void FillLine(const Pixel* image) {
    const Pixel* rows[5];
    for (int k = 0; k < 5; ++k) {
      rows[k] = image + static_cast<std::size_t>(Reflect(front_ + k - 2, image_.height_px)) *
                            static_cast<std::size_t>(image_.width_px);
    }
    // Locals, so that the compiler knows that storing does not change them.
    const Pixel *r0 = rows[0], *r1 = rows[1], *r2 = rows[2], *r3 = rows[3], *r4 = rows[4];
    const int n = image_.width_px, origin = x_begin_ - kReach_px - 2, count = LineLength(),
              shift = levels_.shift_before;
    const int inner_begin = std::clamp(-origin, 0, count), inner_end = std::clamp(n - origin, inner_begin, count);
    std::uint16_t* line = line_.data();
    const auto smooth = [=](int x) {
      const auto at = [x, shift](const Pixel* row) { return sizeof(Pixel) == 1 ? row[x] : row[x] >> shift; };
      return static_cast<std::uint16_t>(at(r0) + at(r4) + 4 * (at(r1) + at(r3) + at(r2)) + 2 * at(r2));
    };
    // A row of an image is another page of memory: asked for in time.
    if (front_ >= 0 && front_ + 5 < image_.height_px) {
      for (int i = inner_begin; i < inner_end; i += static_cast<int>(64 / sizeof(Pixel))) {
        __builtin_prefetch(r4 + 2 * static_cast<std::ptrdiff_t>(n) + origin + i);
      }
    }
    for (int i = inner_begin; i < inner_end; ++i) line[i] = smooth(origin + i);
    const int* reflected = reflected_.data();
    for (int i = 0; i < inner_begin; ++i) line[i] = smooth(reflected[i]);
    for (int i = inner_end; i < count; ++i) line[i] = smooth(reflected[i]);
  }

  int LineLength() const { return width_ + 2 * kReach_px + 4; }

  /// The integral image down to the next boundary row.
  void AddRow() {
    if (image_.Is16Bit()) {
      FillLine(image_.u16.data());
    } else {
      FillLine(image_.u8.data());
    }
    kernels_.integrate(line_.data(), width_ + 2 * kReach_px, levels_.shift_after, Row(front_), Row(front_ + 1));
    ++front_;
  }

  float* RowOf(int octave, int layer, int row) { return octaves_[octave].rows[layer][row % 3].data(); }

  /// det H of all filters that are sampled in pixel row y, spread to the octaves that sample this row.
  void Filters(int y) {
    const float* lines[kFilters] = {};
    for (int f = 0; f < kFilters && y % (1 << kFilter[f].shift) == 0; ++f) {
      const int l = kFilter[f].Lobe(), far = (3 * l - 1) / 2, near = (l - 1) / 2;
      const int offsets[10] = {-(l - 1), l, -far, -near, near + 1, far + 1, -l, 0, 1, l + 1};
      HessianRow row{};
      for (int i = 0; i < 10; ++i) row.rows[i] = Row(y + offsets[i]) + kReach_px - kMargin_px;
      row.count = width_ + 2 * kMargin_px;
      row.lobe = l;
      row.inverse_area = static_cast<float>(kLevelsPerUnit / (kFilter[f].size_px * kFilter[f].size_px));
      row.out = kFilter[f].shift == 0 ? RowOf(0, f, y) : filter_lines_[f].data();
      kernels_.hessian(row);
      lines[f] = row.out;
    }
    for (int o = 1; o < kOctaves && y % (1 << o) == 0; ++o) {
      const OctaveRows& octave = octaves_[o];
      for (int layer = 0; layer < kLayers; ++layer) {
        const float* from = lines[kOctave[o][layer]] + (((octave.first - 1) << o) - (x_begin_ - kMargin_px));
        Decimate(from, o, octave.end - octave.first + 2, RowOf(o, layer, y >> o));
      }
    }
  }

  /// Extrema in sample row `row` of an octave, whose row below is the last one known.
  void Search(int o, int row, std::vector<Feature>& found) {
    const OctaveRows& octave = octaves_[o];
    for (int layer = 1; layer <= 2; ++layer) {
      // The neighbours' filters must lie inside the image.
      const int margin_px = kFilter[kOctave[o][layer + 1]].Reach() + (1 << o);
      const int y_px = row * (1 << o);
      if (y_px < margin_px || y_px > image_.height_px - 1 - margin_px) continue;
      const int begin = std::max(octave.first, (margin_px + (1 << o) - 1) >> o);
      const int last_px = image_.width_px - 1 - margin_px;
      if (last_px < 0) continue;
      const int end = std::min(octave.end, (last_px >> o) + 1);
      if (begin >= end) continue;
      ExtremaRow extrema{};
      for (int k = 0; k < 3; ++k) {
        for (int j = 0; j < 3; ++j) {
          extrema.layers[k][j] = RowOf(o, layer - 1 + k, row - 1 + j) + octave.lead + (begin - octave.first);
        }
      }
      extrema.count = end - begin;
      extrema.threshold = static_cast<float>(options_.hessian_threshold);
      const int count = kernels_.extrema(extrema, columns_.data());
      for (int i = 0; i < count; ++i) {
        Neighborhood around;
        const int column = columns_[static_cast<std::size_t>(i)];
        for (int k = 0; k < 27; ++k)
          around.value[k / 9][k / 3 % 3][k % 3] = extrema.layers[k / 9][k / 3 % 3][column + k % 3 - 1];
        AddFeature(o, layer, row, begin + column, around, found);
      }
    }
  }

  void AddFeature(int o, int layer, int row, int column, const Neighborhood& around, std::vector<Feature>& found) {
    const Offset offset = Interpolate(around);
    if (!offset.is_inside) return;
    const int step = 1 << o, f = kOctave[o][layer];
    const double spacing = kFilter[kOctave[o][layer + 1]].size_px - kFilter[f].size_px;
    Feature feature;
    Keypoint& k = feature.keypoint;
    k.x_px = static_cast<float>((column + offset.x) * step + 0.5);
    k.y_px = static_cast<float>((row + offset.y) * step + 0.5);
    k.scale_px = static_cast<float>(kScalePerSize * (kFilter[f].size_px + offset.layer * spacing));
    k.response = around.value[1][1][1];
    k.sign = SignAt(column * step, row * step, kFilter[f].Lobe());

    Window window{
        .integral = {.data = ring_.get(), .row_mask = kMaskOfRing, .stride = stride_, .origin_x = x_begin_ - kReach_px},
        .x_px = k.x_px,
        .y_px = k.y_px,
        .scale_px = k.scale_px};
    if (!options_.upright) {
      CircleResponses responses;
      kernels_.circle(window, SurfTables(), &responses);
      const Direction direction = DirectionOf(responses);
      window.cosine = static_cast<float>(direction.cosine);
      window.sine = static_cast<float>(direction.sine);
      k.angle_rad = static_cast<float>(AngleOf(direction));
      if (k.angle_rad >= static_cast<float>(2 * std::numbers::pi)) k.angle_rad = 0;
    }
    float sums[kComponents][kCells];
    kernels_.describe(window, SurfTables(), sums);
    feature.descriptor = ToBytes(sums, options_.elements);
    found.push_back(feature);
  }

  /// +1 where the trace of H is negative: a bright blob.
  int SignAt(int x, int y, int l) {
    const auto box = [&](int x0, int y0, int x1, int y1) {
      const auto at = [&](int column, int line) {
        return static_cast<std::uint32_t>(Row(line)[column - x_begin_ + kReach_px]);
      };
      return static_cast<std::int32_t>(at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0));
    };
    const int far = (3 * l - 1) / 2, near = (l - 1) / 2;
    const int d_xx = box(x - far, y - l + 1, x + far + 1, y + l) - 3 * box(x - near, y - l + 1, x + near + 1, y + l);
    const int d_yy = box(x - l + 1, y - far, x + l, y + far + 1) - 3 * box(x - l + 1, y - near, x + l, y + near + 1);
    return std::int64_t{d_xx} + d_yy < 0 ? 1 : -1;
  }

  const GreyImage& image_;
  const SurfOptions& options_;
  const SurfKernels& kernels_;
  const Levels levels_;
  const int stride_;
  int x_begin_ = 0, width_ = 0, front_ = 0;
  std::unique_ptr<std::int32_t[]> ring_;
  std::vector<std::int32_t> columns_;
  std::vector<int> reflected_;  ///< column of the image by element of line_
  std::vector<std::uint16_t> line_;
  std::vector<float> filter_lines_[kFilters];
  OctaveRows octaves_[kOctaves];
};

/// The kernels of this processor or of RILIEVO_KERNELS, read once.
const SurfKernels& ProcessKernels() {
  static const SurfKernels& kernels = ChooseSurfKernels(ForcedKernels());
  return kernels;
}

int StripWidth(int width_px, const Tiling& tiling) {
  return std::clamp(tiling.strip_width_px, 1, std::max(width_px, 1));
}

}  // namespace

std::vector<Feature> DetectSurf(const Input& input, const SurfOptions& options, const Tiling& tiling,
                                RunContext& context) {
  return DetectSurf(input, options, tiling, context, ProcessKernels());
}

std::vector<Feature> DetectSurf(const Input& input, const SurfOptions& options, const Tiling& tiling,
                                RunContext& context, const SurfKernels& kernels) {
  const GreyImage& image = input.image;
  RILIEVO_CHECK(options.elements == 64 || options.elements == 128);
  RILIEVO_CHECK((image.Is16Bit() ? image.u16.size() : image.u8.size()) ==
                static_cast<std::size_t>(image.width_px) * static_cast<std::size_t>(image.height_px));
  context.ThrowIfStopped();
  if (image.width_px <= 0 || image.height_px <= 0) return {};
  const int width_px = StripWidth(image.width_px, tiling);
  const auto strips = static_cast<std::size_t>((image.width_px + width_px - 1) / width_px);
  const std::size_t chunks = std::min(strips, static_cast<std::size_t>(std::max(tiling.chunks, 1)));
  std::vector<std::vector<Feature>> found(chunks);
  context.ParallelFor(chunks, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t chunk = begin; chunk < end; ++chunk) {
      StripRunner runner(image, options, kernels, width_px);
      for (std::size_t strip = chunk * strips / chunks; strip < (chunk + 1) * strips / chunks; ++strip) {
        const int x = static_cast<int>(strip) * width_px;
        runner.Run(x, std::min(x + width_px, image.width_px), context, found[chunk]);
      }
    }
  });
  std::vector<Feature> all;
  for (auto& part : found) {
    all.insert(all.end(), part.begin(), part.end());
    part = {};
  }
  return all;
}

std::uint64_t SurfPeakBytes(int width_px, const Tiling& tiling) {
  const int width = StripWidth(width_px, tiling);
  const auto strips = static_cast<std::uint64_t>((std::max(width_px, 1) + width - 1) / width);
  const auto padded = static_cast<std::uint64_t>(width + 2 * kMargin_px + kOvershoot);
  const std::uint64_t each = static_cast<std::uint64_t>(RingStride(width)) * (4 * kRingRows + 2 + 4) +
                             padded * (4 * kFilters + 4 * 3 * kLayers * kOctaves + 4) + 65536;
  return each * std::min(strips, static_cast<std::uint64_t>(std::max(tiling.chunks, 1)));
}

}  // namespace rilievo::features
