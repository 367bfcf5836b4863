// Bounds from sketches: what can still pass the ratio test, and what is certain (docs/decisions/0014-sketches.md).
#include "stages/matching/sketch_matching.h"

#include <smmintrin.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <span>
#include <utility>

#include "base/check.h"
#include "stages/matching/best_two.h"
#include "stages/matching/distance_kernels.h"
#include "stages/matching/sweep.h"

namespace rilievo::matching {
namespace {

constexpr std::size_t kFewestDescriptors = 256;
constexpr std::size_t kMostLanes = 16, kKeptOfColumn = 3;
constexpr std::int32_t kNone = BestTwo::kNone;

/// Between squared distances of sketches and of descriptors; rounded to the safe side.
class Bounds {
 public:
  Bounds(double error, const RatioTest& test) : error_(error), ratio_(static_cast<double>(test.ratio_e4) * 1e-4) {}

  /// Least squared distance of descriptors whose sketches have that one.
  std::int32_t AtLeast(std::int32_t sketch_sq) const {
    if (sketch_sq == kNone) return kNone;
    const double distance = std::max(std::sqrt(sketch_sq * (1 - kSlack)) - error_, 0.0);
    return static_cast<std::int32_t>(distance * distance * (1 - kSlack));
  }
  /// Squared distance of sketches from which on descriptors do not pass beside a second neighbour of `second_sq`.
  std::int32_t LimitOfFirst(std::int32_t second_sq) const {
    return second_sq == kNone ? kNone : Squared(ratio_ * std::sqrt(static_cast<double>(second_sq)) + error_);
  }
  /// The one from which on descriptors are no second neighbour that a first of `first_sq` fails beside.
  std::int32_t LimitOfSecond(std::int32_t first_sq) const {
    return Squared(std::sqrt(static_cast<double>(first_sq) + 2) / ratio_ + error_);
  }

 private:
  static constexpr double kSlack = 1e-9;
  static std::int32_t Squared(double distance) {
    return static_cast<std::int32_t>(std::min(distance * distance * (1 + kSlack) + 2, double{kNone}));
  }
  double error_, ratio_;
};

/// A row: its two nearest of those compared in full, and how near the sketch of any other is.
struct Row {
  BestTwo nearest;
  std::int32_t others_sq = kNone;
  bool in_full = false;  ///< the bounds do not decide
};

/// A column: its nearest by sketch, and how near the sketch of any other is.
struct Column {
  std::array<std::int32_t, kKeptOfColumn> sketch_sq{kNone, kNone, kNone};
  std::array<std::uint32_t, kKeptOfColumn> row{};
  std::int32_t others_sq = kNone;

  void Offer(std::int32_t distance_sq, std::uint32_t index) {
    for (std::size_t k = 0; k < kKeptOfColumn; ++k) {
      if (distance_sq >= sketch_sq[k]) continue;
      std::swap(distance_sq, sketch_sq[k]);
      std::swap(index, row[k]);
    }
    others_sq = std::min(others_sq, distance_sq);
  }
};

// Of lists of keys, a multiple of four of them.
std::int32_t Least(const std::int32_t* keys, std::size_t count) {
  __m128i least = _mm_loadu_si128(reinterpret_cast<const __m128i*>(keys));
  for (std::size_t i = 4; i < count; i += 4)
    least = _mm_min_epi32(least, _mm_loadu_si128(reinterpret_cast<const __m128i*>(keys + i)));
  least = _mm_min_epi32(least, _mm_shuffle_epi32(least, _MM_SHUFFLE(1, 0, 3, 2)));
  return _mm_cvtsi128_si32(_mm_min_epi32(least, _mm_shuffle_epi32(least, _MM_SHUFFLE(2, 3, 0, 1))));
}
/// A bit for each key below the limit.
std::uint32_t Below(const std::int32_t* keys, std::size_t count, std::int32_t limit) {
  std::uint32_t bits = 0;
  for (std::size_t i = 0; i < count; i += 4) {
    const __m128i four = _mm_loadu_si128(reinterpret_cast<const __m128i*>(keys + i));
    const __m128i below = _mm_cmplt_epi32(four, _mm_set1_epi32(limit));
    bits |= static_cast<std::uint32_t>(_mm_movemask_ps(_mm_castsi128_ps(below))) << i;
  }
  return bits;
}
std::size_t PlaceOf(const std::int32_t* keys, std::size_t count, std::int32_t key) {
  return static_cast<std::size_t>(std::find(keys, keys + count, key) - keys);
}

/// The keys of a row of a sweep: of every lane the least, then of every lane the second. Others of a lane are no less
/// than its second.
struct RowKeys {
  const std::int32_t* keys;
  std::size_t lanes;
  std::int32_t rest_sq;
  std::size_t column_begin;

  std::uint32_t ColumnOf(std::size_t place) const {
    const std::size_t vector = static_cast<std::uint32_t>(keys[place]) % kIndexCount;
    return static_cast<std::uint32_t>(column_begin + vector * lanes + place % lanes);
  }
  std::int32_t SketchSq(std::size_t place) const {
    return keys[place] == kNone ? kNone : (keys[place] >> kIndexBits) + rest_sq;
  }
  /// Keys below it belong to smaller distances of sketches.
  std::int32_t KeyOf(std::int32_t sketch_sq) const {
    const std::int64_t key = (std::int64_t{sketch_sq} - rest_sq) * (1 << kIndexBits);
    return static_cast<std::int32_t>(std::clamp<std::int64_t>(key, -kNone, kNone));
  }
  /// Places of the least two keys.
  std::array<std::size_t, 2> LeastTwo() const {
    const std::size_t winner = PlaceOf(keys, lanes, Least(keys, lanes));
    std::array<std::int32_t, kMostLanes> rest;
    std::copy_n(keys, lanes, rest.data());
    rest[winner] = keys[lanes + winner];
    const std::size_t next = PlaceOf(rest.data(), lanes, Least(rest.data(), lanes));
    return {winner, next == winner ? lanes + winner : next};
  }
  /// The least key of those that are not `seen` or that others of their lane may be behind.
  std::int32_t LeastOfOthers(std::uint32_t seen) const {
    std::array<std::int32_t, kMostLanes> firsts;
    for (std::size_t lane = 0; lane < lanes; ++lane) firsts[lane] = (seen >> lane & 1U) != 0 ? kNone : keys[lane];
    return std::min(Least(firsts.data(), lanes), Least(keys + lanes, lanes));
  }
};

class SketchMatcher {
 public:
  SketchMatcher(const Prepared& a, const Prepared& b, const RatioTest& test, bool mutual)
      : a_(a),
        b_(b),
        test_(test),
        mutual_(mutual),
        bounds_(a.sketches.error + b.sketches.error, test),
        distances_(DistanceKernelOf(a.kernel->name)),
        rows_(a.descriptors.size()),
        columns_(mutual ? b.descriptors.size() : 0) {}

  void SweepSketches(const RunContext& context) {
    Sweep(a_.sketches.packed, b_.sketches.packed, *a_.kernel, context, [&](const SweptBlock& block) {
      const std::size_t lanes = a_.kernel->lanes;
      for (std::size_t i = 0; i < block.rows; ++i) {
        const std::size_t row = block.row_begin + i;
        const RowKeys keys{block.row_keys.data() + i * 2 * lanes, lanes, a_.sketches.packed.rest_sq[row],
                           block.column_begin};
        TakeRow(keys, static_cast<std::uint32_t>(row));
      }
      if (mutual_) TakeColumns(block);
    });
  }

  enum class Verdict : std::uint8_t { kPasses, kFails, kInFull };

  Verdict OfRow(std::uint32_t i) const {
    const Row& row = rows_[i];
    if (row.in_full) return Verdict::kInFull;
    if (!test_.Passes(row.nearest)) return Verdict::kFails;
    return test_.Passes(row.nearest.first_sq, bounds_.AtLeast(row.others_sq)) ? Verdict::kPasses : Verdict::kInFull;
  }
  PassingNeighbor NeighborOf(std::uint32_t i) const { return {i, rows_[i].nearest.index, rows_[i].nearest.first_sq}; }

  /// Whether a neighbour's own nearest is the row, and passes.
  Verdict OfColumn(const PassingNeighbor& neighbor) const {
    const Column& column = columns_[neighbor.second];
    const auto disturbs = [&](std::int32_t distance_sq) { return !test_.Passes(neighbor.distance_sq, distance_sq); };
    for (std::size_t k = 0; k < kKeptOfColumn; ++k) {
      if (column.row[k] == neighbor.first || !disturbs(bounds_.AtLeast(column.sketch_sq[k]))) continue;
      std::int32_t distance_sq = 0;
      Compare(b_, neighbor.second, a_, {&column.row[k], 1}, &distance_sq);
      if (disturbs(distance_sq)) return Verdict::kFails;
    }
    return disturbs(bounds_.AtLeast(column.others_sq)) ? Verdict::kInFull : Verdict::kPasses;
  }

 private:
  /// Squared distances of descriptor i of `of` from some of `in`.
  void Compare(const Prepared& of, std::uint32_t i, const Prepared& in, std::span<const std::uint32_t> indices,
               std::int32_t* distances_sq) const {
    distances_(of.descriptors[i].data(), in.descriptors.front().data(), indices.data(), indices.size(), distances_sq);
  }

  /// Compares the columns at these places in full.
  void Look(Row& row, std::uint32_t i, const RowKeys& keys, std::span<const std::size_t> places) const {
    std::array<std::uint32_t, 2 * kMostLanes> columns;
    std::array<std::int32_t, 2 * kMostLanes> distances_sq;
    for (std::size_t k = 0; k < places.size(); ++k) columns[k] = keys.ColumnOf(places[k]);
    Compare(a_, i, b_, std::span(columns).first(places.size()), distances_sq.data());
    for (std::size_t k = 0; k < places.size(); ++k) Offer(row.nearest, distances_sq[k], columns[k]);
  }

  /// The key below which a column may change the verdict on the row.
  std::int32_t KeyLimit(const Row& row, const RowKeys& keys) const {
    const BestTwo& nearest = row.nearest;
    const std::int32_t first = bounds_.LimitOfFirst(nearest.second_sq);
    return keys.KeyOf(test_.Passes(nearest) ? std::max(first, bounds_.LimitOfSecond(nearest.first_sq)) : first);
  }

  /// Compares in full what may change the verdict, the nearest by sketch first: what they tell lowers the limit.
  void TakeRow(const RowKeys& keys, std::uint32_t i) {
    Row& row = rows_[i];
    if (row.in_full) return;
    const auto least = keys.LeastTwo();
    std::uint32_t seen = (1U << least[0]) | (1U << least[1]);
    Look(row, i, keys, std::span(least).first(keys.keys[least[1]] == kNone ? 1 : 2));
    std::int32_t limit = KeyLimit(row, keys);
    while (std::uint32_t unseen = Below(keys.keys, 2 * keys.lanes, limit) & ~seen) {
      std::array<std::size_t, 2 * kMostLanes> places;
      std::size_t count = 0;
      seen |= unseen;
      for (; unseen != 0; unseen &= unseen - 1) places[count++] = static_cast<std::size_t>(std::countr_zero(unseen));
      Look(row, i, keys, std::span(places).first(count));
      limit = KeyLimit(row, keys);
    }
    const std::int32_t others = keys.LeastOfOthers(seen);
    row.in_full = others < limit;  // a third of a lane may hide behind its second
    if (others != kNone) row.others_sq = std::min(row.others_sq, (others >> kIndexBits) + keys.rest_sq);
  }

  void TakeColumns(const SweptBlock& block) {
    const std::size_t lanes = a_.kernel->lanes;
    const std::int32_t* keys = block.column_keys.data();
    std::int32_t vector = 0;
    for (std::size_t begin = 0; begin < block.columns; begin += lanes, ++vector, keys += 2 * lanes) {
      for (std::size_t lane = 0; lane < std::min(lanes, block.columns - begin); ++lane) {
        Column& column = columns_[block.column_begin + begin + lane];
        for (const std::int32_t key : {keys[lane], keys[lanes + lane]}) {
          if (key == kNone) continue;
          const auto row = static_cast<std::uint32_t>(key - vector) % static_cast<std::uint32_t>(kIndexCount);
          column.Offer((key - vector) >> kIndexBits, static_cast<std::uint32_t>(block.row_begin) + row);
        }
        // Further rows of the block are no nearer than its second.
        if (const std::int32_t second = keys[lanes + lane]; second != kNone)
          column.others_sq = std::min(column.others_sq, (second - vector) >> kIndexBits);
      }
    }
  }

  const Prepared &a_, &b_;
  RatioTest test_;
  bool mutual_;
  Bounds bounds_;
  DistanceKernel distances_;
  std::vector<Row> rows_;
  std::vector<Column> columns_;
};

/// Compares some descriptors of `of` with all of `in`; `take(place in the list, its two nearest)`.
template <class Take>
void CompareInFull(std::span<const std::uint32_t> list, const Prepared& of, const Prepared& in,
                   const RunContext& context, Take&& take) {
  for (std::size_t begin = 0; begin < list.size(); begin += kRowsPerBlock) {
    const auto part = list.subspan(begin, std::min(kRowsPerBlock, list.size() - begin));
    const std::vector<BestTwo> nearest = FindTwoNearestOf(part, of, in, context);
    for (std::size_t i = 0; i < part.size(); ++i) take(begin + i, nearest[i]);
  }
}

}  // namespace

bool CanMatchBySketches(const Prepared& a, const Prepared& b) {
  return a.sketches.Exist() && b.sketches.Exist() && a.packed.center == 0 && b.packed.center == 0 &&
         std::min(a.descriptors.size(), b.descriptors.size()) >= kFewestDescriptors;
}

std::vector<PassingNeighbor> MatchBySketches(const Prepared& a, const Prepared& b, const RatioTest& test, bool mutual,
                                             const RunContext& context, SketchCounts* counts) {
  RILIEVO_CHECK(a.kernel == b.kernel && CanMatchBySketches(a, b));
  SketchMatcher matcher(a, b, test, mutual);
  matcher.SweepSketches(context);
  std::vector<PassingNeighbor> passing;
  std::vector<std::uint32_t> rows;
  for (std::uint32_t i = 0; i < a.descriptors.size(); ++i) {
    const auto verdict = matcher.OfRow(i);
    if (verdict == SketchMatcher::Verdict::kPasses) passing.push_back(matcher.NeighborOf(i));
    if (verdict == SketchMatcher::Verdict::kInFull) rows.push_back(i);
  }
  CompareInFull(rows, a, b, context, [&](std::size_t i, const BestTwo& best) {
    if (test.Passes(best)) passing.push_back({rows[i], best.index, best.first_sq});
  });
  std::sort(passing.begin(), passing.end(), [](const auto& x, const auto& y) { return x.first < y.first; });
  if (counts != nullptr) *counts = {rows.size(), 0};
  if (!mutual) return passing;

  std::vector<PassingNeighbor> matches, undecided;
  std::vector<std::uint32_t> columns;
  for (const PassingNeighbor& neighbor : passing) {
    const auto verdict = matcher.OfColumn(neighbor);
    if (verdict == SketchMatcher::Verdict::kPasses) matches.push_back(neighbor);
    if (verdict != SketchMatcher::Verdict::kInFull) continue;
    undecided.push_back(neighbor);
    columns.push_back(neighbor.second);
  }
  CompareInFull(columns, b, a, context, [&](std::size_t i, const BestTwo& best) {
    if (best.index == undecided[i].first && test.Passes(best)) matches.push_back(undecided[i]);
  });
  std::sort(matches.begin(), matches.end(), [](const auto& x, const auto& y) { return x.first < y.first; });
  if (counts != nullptr) counts->full_columns = columns.size();
  return matches;
}

std::size_t MatchBySketchesBytes(std::size_t a, std::size_t b) {
  // Lists grow by doubling: three times their length while they move.
  const std::size_t lists = 3 * (3 * sizeof(PassingNeighbor) + 2 * sizeof(std::uint32_t)) * a;
  const std::size_t in_full =
      128 * kRowsPerBlock + PackedBytes(kRowsPerBlock) + TwoNearestBytes(kRowsPerBlock, std::max(a, b));
  return a * sizeof(Row) + b * sizeof(Column) + TwoNearestBytes(a, b) + in_full + lists;
}

}  // namespace rilievo::matching
