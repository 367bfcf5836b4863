// Bounds from sketches: what can still pass the ratio test, and what is certain (docs/decisions/0014-sketches.md).
#include "stages/matching/sketch_matching.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "base/check.h"
#include "stages/matching/distance_kernels.h"
#include "stages/matching/sweep.h"

namespace rilievo::matching {
namespace {

constexpr std::size_t kFewestDescriptors = 256;
constexpr std::size_t kMostCandidates = 8;  ///< of a row; with more it is compared in full
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
  std::int32_t Limit(std::int32_t second_sq) const {
    if (second_sq == kNone) return kNone;
    const double distance = ratio_ * std::sqrt(static_cast<double>(second_sq)) + error_;
    return static_cast<std::int32_t>(std::min(distance * distance * (1 + kSlack) + 1, double{kNone}));
  }

 private:
  static constexpr double kSlack = 1e-9;
  double error_, ratio_;
};

/// Nearest two by sketches, and what follows for the descriptors.
struct Nearest {
  std::int32_t first_sq = kNone, second_sq = kNone;  ///< of sketches
  std::uint32_t first = 0, second = 0;
  std::int32_t upper_sq = kNone;  ///< two descriptors are no further than that
  std::int32_t limit_sq = kNone;  ///< sketches no nearer than that belong to nothing that passes

  void Offer(std::int32_t sketch_sq, std::uint32_t index) {
    if (sketch_sq < first_sq) {
      second_sq = first_sq, second = first;
      first_sq = sketch_sq, first = index;
    } else if (sketch_sq < second_sq) {
      second_sq = sketch_sq, second = index;
    }
  }
  /// Of all but `index`, by sketches.
  std::int32_t WithoutSq(std::uint32_t index) const { return first == index ? second_sq : first_sq; }
};

struct Candidate {
  std::uint32_t row, column;
  std::int32_t sketch_sq;
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
        columns_(mutual ? b.descriptors.size() : 0),
        in_full_(a.descriptors.size(), false) {}

  void SweepSketches(const RunContext& context) {
    Sweep(a_.sketches.packed, b_.sketches.packed, *a_.kernel, context, [&](const SweptBlock& block) {
      for (std::size_t i = 0; i < block.rows; ++i) TakeRow(block, i);
      if (mutual_) TakeColumns(block);
    });
    for (std::uint32_t j = 0; j < columns_.size(); ++j) Bound(columns_[j], b_, j, a_, columns_[j]);
  }

  /// Candidates of rows that are certain to pass; notes the rows whose candidates are not.
  std::vector<PassingNeighbor> CertainRows() {
    std::vector<PassingNeighbor> certain;
    for (const Candidate& c : candidates_) {
      const Nearest& row = rows_[c.row];
      if (in_full_[c.row] || c.sketch_sq >= row.limit_sq) continue;
      if (mutual_ && c.sketch_sq >= columns_[c.column].limit_sq) continue;
      const std::int32_t distance_sq = Distance(c.row, c.column);
      if (!test_.Passes(distance_sq, row.upper_sq)) continue;
      if (mutual_ && !test_.Passes(distance_sq, columns_[c.column].upper_sq)) continue;
      if (test_.Passes(distance_sq, bounds_.AtLeast(row.WithoutSq(c.column))))
        certain.push_back({c.row, c.column, distance_sq});
      else
        in_full_[c.row] = true;
    }
    std::erase_if(certain, [&](const PassingNeighbor& n) { return in_full_[n.first]; });
    return certain;
  }

  std::vector<std::uint32_t> RowsInFull() const {
    std::vector<std::uint32_t> rows;
    for (std::uint32_t i = 0; i < in_full_.size(); ++i)
      if (in_full_[i]) rows.push_back(i);
    return rows;
  }

  enum class Verdict : std::uint8_t { kPasses, kFails, kInFull };
  /// Whether a neighbour's own nearest is the row, and passes.
  Verdict OfColumn(const PassingNeighbor& neighbor) const {
    const Nearest& column = columns_[neighbor.second];
    if (test_.Passes(neighbor.distance_sq, bounds_.AtLeast(column.WithoutSq(neighbor.first)))) return Verdict::kPasses;
    for (const std::uint32_t other : {column.first, column.second})
      if (other != neighbor.first && !test_.Passes(neighbor.distance_sq, Distance(other, neighbor.second)))
        return Verdict::kFails;
    return Verdict::kInFull;
  }

  std::size_t CandidateCount() const { return candidates_.size(); }

 private:
  std::int32_t Distance(std::uint32_t row, std::uint32_t column) const {
    std::int32_t distance_sq = 0;
    distances_(a_.descriptors[row].data(), b_.descriptors.front().data(), &column, 1, &distance_sq);
    return distance_sq;
  }

  /// Compares descriptor i of `of` with the two nearest of `found` in full.
  void Bound(Nearest& nearest, const Prepared& of, std::uint32_t i, const Prepared& in, const Nearest& found) const {
    if (found.second_sq != kNone) {
      const std::uint32_t indices[2] = {found.first, found.second};
      std::int32_t distances_sq[2];
      distances_(of.descriptors[i].data(), in.descriptors.front().data(), indices, 2, distances_sq);
      nearest.upper_sq = std::min(nearest.upper_sq, std::max(distances_sq[0], distances_sq[1]));
    }
    nearest.limit_sq = bounds_.Limit(nearest.upper_sq);
  }

  /// Each lane has its two smallest keys: a row's candidates are known unless a lane's second is one too.
  void TakeRow(const SweptBlock& block, std::size_t row_in_block) {
    const std::size_t lanes = a_.kernel->lanes;
    const std::int32_t* keys = block.row_keys.data() + row_in_block * 2 * lanes;
    const auto row = static_cast<std::uint32_t>(block.row_begin + row_in_block);
    const std::int32_t rest_sq = a_.sketches.packed.rest_sq[row];
    const auto column_of = [&](std::size_t place) {
      const std::size_t vector = static_cast<std::uint32_t>(keys[place]) % kIndexCount;
      return static_cast<std::uint32_t>(block.column_begin + vector * lanes + place % lanes);
    };
    const auto sketch_sq = [&](std::size_t place) {
      return keys[place] == kNone ? kNone : (keys[place] >> kIndexBits) + rest_sq;
    };
    const auto winner = static_cast<std::size_t>(std::min_element(keys, keys + lanes) - keys);
    std::size_t next = lanes + winner;
    for (std::size_t place = 0; place < lanes; ++place)
      if (place != winner && keys[place] < keys[next]) next = place;
    Nearest here;
    here.Offer(sketch_sq(winner), column_of(winner));
    if (keys[next] != kNone) here.Offer(sketch_sq(next), column_of(next));
    Nearest& nearest = rows_[row];
    nearest.Offer(here.first_sq, here.first);
    nearest.Offer(here.second_sq, here.second);
    Bound(nearest, a_, row, b_, here);
    if (in_full_[row] || here.first_sq >= nearest.limit_sq) return;
    const std::int64_t key_limit = (std::int64_t{nearest.limit_sq} - rest_sq) * (1 << kIndexBits);
    const auto limit = static_cast<std::int32_t>(std::clamp<std::int64_t>(key_limit, -kNone, kNone));
    std::size_t found = 0;
    bool hidden = false;
    for (std::size_t lane = 0; lane < lanes; ++lane) {
      found += keys[lane] < limit;
      hidden |= keys[lanes + lane] < limit;
    }
    if (hidden || found > kMostCandidates) {
      in_full_[row] = true;
      return;
    }
    for (std::size_t lane = 0; lane < lanes; ++lane)
      if (keys[lane] < limit) candidates_.push_back({row, column_of(lane), sketch_sq(lane)});
  }

  void TakeColumns(const SweptBlock& block) {
    const std::size_t lanes = a_.kernel->lanes;
    const std::int32_t* keys = block.column_keys.data();
    std::int32_t vector = 0;
    for (std::size_t begin = 0; begin < block.columns; begin += lanes, ++vector, keys += 2 * lanes) {
      for (std::size_t lane = 0; lane < std::min(lanes, block.columns - begin); ++lane) {
        Nearest& column = columns_[block.column_begin + begin + lane];
        for (const std::int32_t key : {keys[lane], keys[lanes + lane]}) {
          if (key == kNone) continue;
          const auto row = static_cast<std::uint32_t>(key - vector) % static_cast<std::uint32_t>(kIndexCount);
          column.Offer((key - vector) >> kIndexBits, static_cast<std::uint32_t>(block.row_begin) + row);
        }
      }
    }
  }

  const Prepared &a_, &b_;
  RatioTest test_;
  bool mutual_;
  Bounds bounds_;
  DistanceKernel distances_;
  std::vector<Nearest> rows_, columns_;
  std::vector<bool> in_full_;  ///< rows whose bounds do not decide
  std::vector<Candidate> candidates_;
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
  std::vector<PassingNeighbor> passing = matcher.CertainRows();
  const std::vector<std::uint32_t> rows = matcher.RowsInFull();
  CompareInFull(rows, a, b, context, [&](std::size_t i, const BestTwo& best) {
    if (test.Passes(best)) passing.push_back({rows[i], best.index, best.first_sq});
  });
  std::sort(passing.begin(), passing.end(), [](const auto& x, const auto& y) { return x.first < y.first; });
  if (counts != nullptr) *counts = {matcher.CandidateCount(), rows.size(), 0};
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
  // Lists of neighbours grow by doubling: three times their length while they move.
  const std::size_t rows =
      a * (sizeof(Nearest) + 1 + 3 * kMostCandidates * sizeof(Candidate) + 9 * sizeof(PassingNeighbor));
  const std::size_t in_full =
      128 * kRowsPerBlock + PackedBytes(kRowsPerBlock) + TwoNearestBytes(kRowsPerBlock, std::max(a, b));
  return rows + b * sizeof(Nearest) + TwoNearestBytes(a, b) + in_full + 8 * (a + b);
}

}  // namespace rilievo::matching
