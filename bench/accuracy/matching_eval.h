// Matching strategies beside m2 (all with all, exact): what bench_table1.py asks for.
#pragma once

#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "block/features.h"
#include "stages/matching/matching.h"

namespace rilievo::bench {

using Json = nlohmann::json;

/// Matches and least CPU seconds of one way to match.
struct Timed {
  std::vector<Match> matches;
  double cpu_s = 0;
};

/// The least CPU time of up to five runs; what takes longer than two seconds runs once.
Timed MatchTimed(std::span<const Descriptor> a, std::span<const Descriptor> b, const matching::Options& options);

/// {matcher, checks or visits, matches, recall: share of the reference's matches that are found, extra: matches that
/// the reference has not, as a share of its number, cpu_s}.
Json BesideReference(const Timed& timed, const Timed& reference);

/// Renders two images of a relief, takes the strongest features of each, as many as asked for or as there are, and
/// matches them by trees with `checks` and by m2. `exact`: also by trees without limit.
Json MeasureTableRow(int width_px, int height_px, std::size_t features_a, std::size_t features_b, int checks,
                     bool exact);

/// Strategies beside m2 for large numbers of features of photographs, first and second image of a pair in turns. The
/// features of several first images count as one image's, those of the second ones likewise.
Json MeasureLarge(std::size_t features, const std::vector<std::string>& images);

}  // namespace rilievo::bench
