// One octave of SIFT's scale space, worked through in strips: its features, and the image of the next octave.
#include "stages/features/octave.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "base/check.h"
#include "stages/features/fixed_math.h"
#include "stages/features/refine.h"

namespace rilievo::features {
namespace {

/// Columns to the left of a strip in its rings; to the right as many, and the kernels' overshoot.
constexpr int kMargin_px = 80;
static_assert(kHalo_px[0] <= kMargin_px && kMargin_px % (2 * kBlockRows) == 0);
/// The same in scratch rows: the first blur looks at more than a margin.
constexpr int kScratchMargin_px = kMargin_px + 16;
/// Source pixels to the left of a strip.
constexpr int kSourceMargin_px = kMargin_px / 2 + 2 * kUpsampleRadius_px + 6;

/// Rows each layer's ring holds, powers of two. A layer is needed from the oldest row that any later step looks at to
/// the row that its filter is writing.
constexpr std::array<int, kLayers> kRingRows = {64, 128, 128, 128, 32, 16};
constexpr bool RingsSuffice() {
  for (std::size_t i = 0; i < kLayers; ++i) {
    int oldest = kSearchLag_px + kSearchReach_px;
    if (i + 1 < kLayers) oldest = std::max(oldest, kLag_px[i + 1] + kBlurRadius_px[i]);
    if (i >= 1 && i <= kScales) oldest = std::max(oldest, kDescribeLag_px + kDescriptorReach_px);
    if (oldest - kLag_px[i] + kBlockRows > kRingRows[i]) return false;
  }
  return true;
}
static_assert(RingsSuffice());

class Ring {
 public:
  Ring(int rows, int stride)
      : pixels_(static_cast<std::size_t>(rows) * static_cast<std::size_t>(stride)), rows_(rows), stride_(stride) {}
  /// Column 0 of the strip in row y, any y.
  std::uint16_t* Row(int y) {
    return pixels_.data() + static_cast<std::ptrdiff_t>(y & (rows_ - 1)) * stride_ + kMargin_px;
  }
  RingView View() const { return {pixels_.data() + kMargin_px, rows_ - 1, stride_}; }

 private:
  std::vector<std::uint16_t> pixels_;
  int rows_, stride_;
};

/// Everything that a strip needs while it is worked through; made once for a group of strips.
struct Workspace {
  explicit Workspace(int strip_width_px)
      : stride(kMargin_px + strip_width_px + kMargin_px + kOvershoot_px),
        blur_scratch(static_cast<std::size_t>(4 * ScratchStride())),
        search_scratch(static_cast<std::size_t>(kSearchScratchRows * (stride + kOvershoot_px))),
        candidates(static_cast<std::size_t>(kBlockRows * kScales * (strip_width_px + kOvershoot_px))),
        columns(static_cast<std::size_t>(strip_width_px + 2)) {
    for (const int rows : kRingRows) rings.emplace_back(rows, stride);
  }
  int ScratchStride() const { return stride + 2 * (kScratchMargin_px - kMargin_px); }
  int stride;
  std::vector<Ring> rings;
  std::vector<float> blur_scratch;
  std::vector<std::int16_t> search_scratch;
  std::vector<Candidate> candidates;
  std::vector<std::int32_t> columns;
  std::vector<float> source;      ///< ring of 16 rows of image pixels, first octave only
  std::optional<Ring> unblurred;  ///< image in layer units, when it is not doubled
};

/// Of the blurs of a block of rows one in sixteen is timed: reading the clock takes a tenth of their time.
constexpr int kBlocksPerSample = 16;
constexpr KernelName kScaleSpaceKernel{"scale space", KernelName::Arithmetic::kFloats};

/// Of the blurs of a block of rows with their halos, along both axes.
double BlurMultiplyAdds(int strip_width_px) {
  double sum = 0;
  for (std::size_t i = 0; i < kBlurs; ++i)
    sum += 2.0 * (2 * kBlurRadius_px[i] + 1) * kBlockRows * (strip_width_px + 2 * kHalo_px[i + 1]);
  return sum;
}

/// out[i] = row[begin + i], mirrored beyond [0, size).
template <class In, class Out>
void CopyMirrored(const In* row, int size, int begin, int count, Out* out) {
  const int inner_begin = std::clamp(-begin, 0, count), inner_end = std::clamp(size - begin, inner_begin, count);
  for (int i = 0; i < inner_begin; ++i) out[i] = static_cast<Out>(row[Mirror(begin + i, size)]);
  std::copy(row + begin + inner_begin, row + begin + inner_end, out + inner_begin);
  for (int i = inner_end; i < count; ++i) out[i] = static_cast<Out>(row[Mirror(begin + i, size)]);
}

/// Grey values of row y, columns [begin, begin + count), mirrored beyond the image.
void CopySourceRow(const GreyImage& image, int y, int begin, int count, float* out) {
  const std::size_t row =
      static_cast<std::size_t>(Mirror(y, image.height_px)) * static_cast<std::size_t>(image.width_px);
  if (image.Is16Bit())
    CopyMirrored(&image.u16[row], image.width_px, begin, count, out);
  else
    CopyMirrored(&image.u8[row], image.width_px, begin, count, out);
}

class StripRunner {
 public:
  StripRunner(const OctaveInput& input, const SiftThresholds& thresholds, const Describer& describe,
              const SiftKernels& kernels, Workspace& workspace, int begin_px, int end_px, Plane& next,
              FeatureCollector& features)
      : input_(input),
        thresholds_(thresholds),
        describe_(describe),
        kernels_(kernels),
        w_(workspace),
        x0_(begin_px),
        width_(end_px - begin_px),
        next_(next),
        features_(features) {
    for (int i = 0; i < kLayers; ++i) views_.layers[i] = w_.rings[static_cast<std::size_t>(i)].View();
    // A little below the threshold: the extremum between the samples is higher than they are.
    const double least = 0.8 * thresholds.contrast / kScales * 255.0 * kUnitsPerLevel;
    search_threshold_ = static_cast<std::int16_t>(std::clamp(least, 1.0, 32000.0));
  }

  void Run(RunContext& context) {
    for (int y = -kMargin_px; y - kDescribeLag_px < input_.height_px; y += kBlockRows) {
      context.ThrowIfStopped();
      FillBase(y);
      if (y / kBlockRows % kBlocksPerSample == 0)
        context.RunKernel(kScaleSpaceKernel, BlurMultiplyAdds(width_), [&] { BlurLayers(y); });
      else
        BlurLayers(y);
      Decimate(y + kBlockRows - kLag_px[kScales]);
      SearchRows(y - kSearchLag_px);
      DescribeRows(y - kDescribeLag_px + kBlockRows);
    }
  }

 private:
  struct Pending {
    Extremum extremum;
    int first_row;  ///< of the sample that was found
  };

  /// Rows y .. y + 7 of layer 0, with all columns of the margin.
  void FillBase(int y) {
    if (input_.base != nullptr) {
      for (int r = y; r < y + kBlockRows; ++r) CopyBaseRow(r, w_.rings[0].Row(r));
    } else if (input_.index == -1) {
      Double(y);
    } else {
      FirstBlur(y);
    }
  }

  void CopyBaseRow(int y, std::uint16_t* out) const {
    const Plane& base = *input_.base;
    const std::uint16_t* row = base.pixels.data() + static_cast<std::size_t>(Mirror(y, base.height_px)) *
                                                        static_cast<std::size_t>(base.width_px);
    CopyMirrored(row, base.width_px, x0_ - kMargin_px, width_ + 2 * kMargin_px, out - kMargin_px);
  }

  /// Row m of the image, column 0 = the strip's first pixel of the image.
  float* SourceRow(int m) {
    return w_.source.data() + static_cast<std::ptrdiff_t>(m & 15) * SourceStride() + kSourceMargin_px;
  }
  int SourceStride() const { return w_.stride / 2 + 2 * kSourceMargin_px + kOvershoot_px; }

  void Double(int y) {
    w_.source.resize(static_cast<std::size_t>(16 * SourceStride()));
    const int middle = y / 2, x0 = x0_ / 2, half = kMargin_px / 2;  // y and x0 are even
    const int begin = -half - kUpsampleRadius_px, count = width_ / 2 + 1 + 2 * (half + kUpsampleRadius_px);
    const int first = y == -kMargin_px ? middle - kUpsampleRadius_px : middle + kUpsampleRadius_px;
    for (int m = first; m < middle + kBlockRows / 2 + kUpsampleRadius_px; ++m)
      CopySourceRow(input_.source.image, m, x0 + begin, count, SourceRow(m) + begin);
    for (int m = middle; m < middle + kBlockRows / 2; ++m) {
      UpsampleBlock block;
      for (int t = 0; t <= kUpsampleTaps; ++t) block.in[t] = SourceRow(m + t - kUpsampleRadius_px);
      block.out[0] = w_.rings[0].Row(2 * m);
      block.out[1] = w_.rings[0].Row(2 * m + 1);
      block.begin = -half;
      block.end = (width_ + 1) / 2 + half;
      block.weights = Tables().upsample_weights;
      block.gain = input_.gain;
      block.scratch = w_.blur_scratch.data() + kScratchMargin_px;
      block.scratch_stride = static_cast<std::size_t>(w_.ScratchStride());
      kernels_.upsample(block);
    }
  }

  /// The image in layer units, then its first blur. Column 0 of the unblurred rows lies kFirstBlurRadius_px further in.
  void FirstBlur(int y) {
    constexpr int kR = kFirstBlurRadius_px;
    if (!w_.unblurred) w_.unblurred.emplace(32, w_.stride + 2 * kR);
    const int count = width_ + 2 * (kMargin_px + kR);
    w_.source.resize(static_cast<std::size_t>(count));
    for (int r = y == -kMargin_px ? y - kR : y + kR; r < y + kBlockRows + kR; ++r) {
      CopySourceRow(input_.source.image, r, x0_ - kMargin_px - kR, count, w_.source.data());
      std::uint16_t* out = w_.unblurred->Row(r) - kMargin_px;
      for (int i = 0; i < count; ++i)
        out[i] = static_cast<std::uint16_t>(std::nearbyint(w_.source[static_cast<std::size_t>(i)] * input_.gain));
    }
    Blur(*w_.unblurred, kR, w_.rings[0], Tables().first_blur_weights, kR, y, kMargin_px);
  }

  /// Rows y .. y + 7 of `to`, `halo` columns beyond the strip; column 0 of `from` is its column `shift`.
  void Blur(Ring& from, int shift, Ring& to, const float* weights, int radius, int y, int halo) {
    BlurBlock block;
    block.radius = radius;
    block.weights = weights;
    for (int k = 0; k < kBlockRows + 2 * radius; ++k) block.in[k] = from.Row(y - radius + k) + shift;
    for (int k = 0; k < kBlockRows; ++k) block.out[k] = to.Row(y + k);
    block.begin = -halo;
    block.end = width_ + halo;
    block.scratch = w_.blur_scratch.data() + kScratchMargin_px;
    block.scratch_stride = static_cast<std::size_t>(w_.ScratchStride());
    kernels_.blur(block);
  }

  void BlurLayers(int y) {
    for (int i = 0; i < kBlurs; ++i) BlurLayer(i, y - kLag_px[static_cast<std::size_t>(i) + 1]);
  }

  /// Rows y .. y + 7 of layer i + 1.
  void BlurLayer(int i, int y) {
    const auto k = static_cast<std::size_t>(i);
    Blur(w_.rings[k], 0, w_.rings[k + 1], Tables().blur_weights[i], kBlurRadius_px[k], y, kHalo_px[k + 1]);
  }

  /// The next octave's pixels that layer kScales, known up to row `known`, is enough for: each lies in the middle of
  /// four of ours; (-1 9 9 -1) / 16 along each axis interpolates there without blurring (its second moment is zero).
  void Decimate(int known) {
    const int begin = x0_ / 2, end = std::min((x0_ + width_) / 2, next_.width_px);
    for (; next_row_ < next_.height_px && 2 * next_row_ + 2 < known; ++next_row_) {
      const std::uint16_t* rows[4];
      for (int k = 0; k < 4; ++k) rows[k] = w_.rings[kScales].Row(2 * next_row_ - 1 + k);
      std::int32_t* column = w_.columns.data() + 1;  // vertical sums of columns -1 .. width
      for (int c = -1; c <= width_; ++c) {
        column[c] = 9 * (static_cast<std::int32_t>(rows[1][c]) + rows[2][c]) -
                    (static_cast<std::int32_t>(rows[0][c]) + rows[3][c]);
      }
      std::uint16_t* out =
          next_.pixels.data() + static_cast<std::size_t>(next_row_) * static_cast<std::size_t>(next_.width_px);
      for (int x = begin; x < end; ++x) {
        const std::int32_t* c = column + (2 * x - x0_);
        out[x] = static_cast<std::uint16_t>(std::clamp((9 * (c[0] + c[1]) - (c[-1] + c[2]) + 128) >> 8, 0, 65535));
      }
    }
  }

  void SearchRows(int y) {
    const int last = std::min(y + kBlockRows, input_.height_px - kBorder_px);
    if (last <= kBorder_px || y >= last) return;
    SearchBlock block;
    for (int i = 0; i < kLayers; ++i)
      for (int r = 0; r < kBlockRows + 2; ++r)
        block.layers[i][r] = w_.rings[static_cast<std::size_t>(i)].Row(y - 1 + r);
    block.begin = std::max(0, kBorder_px - x0_);
    block.end = std::min(width_, input_.width_px - kBorder_px - x0_);
    block.threshold = search_threshold_;
    block.scratch = w_.search_scratch.data() + kOvershoot_px;
    block.scratch_stride = static_cast<std::size_t>(w_.stride + kOvershoot_px);
    if (block.begin >= block.end) return;
    const std::size_t count = kernels_.search(block, w_.candidates.data(), w_.candidates.size());
    for (std::size_t i = 0; i < count; ++i) {
      const Candidate& c = w_.candidates[i];
      const int row = y + c.row;
      if (row < kBorder_px || row >= last) continue;
      const auto extremum = Refine(views_, c.scale, row, c.column, thresholds_);
      if (extremum && IsUsed(input_.source, ImageX(*extremum), ImageY(*extremum))) pending_.push_back({*extremum, row});
    }
  }

  double ImageX(const Extremum& e) const { return (x0_ + e.column + e.d_column + 0.5) * Step(); }
  double ImageY(const Extremum& e) const { return (e.row + e.d_row + 0.5) * Step(); }
  double Step() const { return std::ldexp(1.0, input_.index); }

  Keypoint KeypointOf(const Extremum& e) const {
    const PositionCovariance covariance = CovarianceOf(e, Step(), input_.surplus_px2);
    const double scale_px = LayerSigma(e.scale + e.d_scale, input_.surplus_px2) * Step();
    return {.x_px = static_cast<float>(ImageX(e)),
            .y_px = static_cast<float>(ImageY(e)),
            .scale_px = static_cast<float>(scale_px),
            .angle_rad = 0,
            .response = static_cast<float>(std::fabs(e.value) / (255.0 * kUnitsPerLevel)),
            .cov_xx_px2 = static_cast<float>(covariance.xx),
            .cov_xy_px2 = static_cast<float>(covariance.xy),
            .cov_yy_px2 = static_cast<float>(covariance.yy),
            .sign = e.value < 0 ? 1 : -1};  // the wider blur is darker in the middle of a bright blob
  }

  /// Describes what was found above row `end`: the rows that it needs exist now.
  void DescribeRows(int end) {
    std::size_t done = 0;
    for (; done < pending_.size() && pending_[done].first_row < end; ++done) DescribeFeature(pending_[done].extremum);
    pending_.erase(pending_.begin(), pending_.begin() + static_cast<std::ptrdiff_t>(done));
  }

  void DescribeFeature(const Extremum& e) {
    Feature feature{KeypointOf(e), {}};
    if (!describe_) {
      features_.Add(feature);
      return;
    }
    Patch patch;
    patch.layer = views_.layers[e.scale];
    // Counted from a pixel nearby, the same whatever the strip: small numbers keep all bits for the fraction.
    patch.layer.data += e.column - kMargin_px;
    const int turn = (e.row - kMargin_px) & ~patch.layer.row_mask;
    patch.x = static_cast<float>(kMargin_px + e.d_column);
    patch.y = static_cast<float>(e.row - turn + e.d_row);
    patch.sigma_px = static_cast<float>(LayerSigma(e.scale + e.d_scale, input_.surplus_px2));
    const Orientations orientations = kernels_.orient(patch);
    for (int i = 0; i < orientations.count; ++i) {
      const double angle_rad = 2 * std::numbers::pi * static_cast<double>(orientations.turns[i]);
      const SinCosValue direction = SinCos(angle_rad);
      feature.keypoint.angle_rad = static_cast<float>(angle_rad);
      feature.descriptor =
          describe_(kernels_, patch, static_cast<float>(direction.cos), static_cast<float>(direction.sin));
      features_.Add(feature);
    }
  }

  const OctaveInput& input_;
  const SiftThresholds& thresholds_;
  const Describer& describe_;
  const SiftKernels& kernels_;
  Workspace& w_;
  int x0_, width_;
  Plane& next_;
  FeatureCollector& features_;
  LayerViews views_;
  std::int16_t search_threshold_ = 1;
  int next_row_ = 0;
  std::vector<Pending> pending_;
};

}  // namespace

OctaveOutput RunOctave(const OctaveInput& input, const SiftThresholds& thresholds, const Describer& describe,
                       const SelectionRule& rule, const SiftKernels& kernels, RunContext& context) {
  const Tiling& tiling = input.source.tiling;
  const int strip_width = std::min((tiling.strip_width_px + 1) & ~1, (input.width_px + 1) & ~1);
  RILIEVO_CHECK(strip_width > 0 && tiling.chunks > 0);
  const auto strips = static_cast<std::size_t>((input.width_px + strip_width - 1) / strip_width);
  OctaveOutput output;
  output.next.width_px = input.width_px / 2;
  output.next.height_px = input.height_px / 2;
  output.next.pixels.resize(static_cast<std::size_t>(output.next.width_px) *
                            static_cast<std::size_t>(output.next.height_px));
  const std::size_t chunks = std::min<std::size_t>(strips, static_cast<std::size_t>(tiling.chunks));
  std::vector<FeatureCollector> collectors(chunks, FeatureCollector(rule));
  context.ParallelFor(chunks, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t chunk = begin; chunk < end; ++chunk) {
      Workspace workspace(strip_width);
      for (std::size_t s = chunk; s < strips; s += chunks) {
        const int x0 = static_cast<int>(s) * strip_width, x1 = std::min(input.width_px, x0 + strip_width);
        StripRunner(input, thresholds, describe, kernels, workspace, x0, x1, output.next, collectors[chunk])
            .Run(context);
      }
    }
  });
  FeatureCollector all(rule);
  for (FeatureCollector& collector : collectors) all.Add(collector.Take());
  output.features = all.Take();
  return output;
}

std::size_t OctaveWorkspaceBytes(int width_px, const Tiling& tiling) {
  const int strip_width = std::min((tiling.strip_width_px + 1) & ~1, (width_px + 1) & ~1);
  const auto stride = static_cast<std::size_t>(2 * kMargin_px + strip_width + kOvershoot_px);
  const auto strips = static_cast<std::size_t>((width_px + strip_width - 1) / std::max(1, strip_width));
  std::size_t rows = 0;
  for (const int r : kRingRows) rows += static_cast<std::size_t>(r);
  const std::size_t each = stride * (rows * 2 + 4 * sizeof(float) + kSearchScratchRows * 2 + 16 * sizeof(float) +
                                     kBlockRows * kScales * sizeof(Candidate)) +
                           (std::size_t{64} << 10);
  return each * std::min<std::size_t>(strips, static_cast<std::size_t>(tiling.chunks));
}

}  // namespace rilievo::features
