// Writes the counts of tie points as text and JSON.
#include "stages/reporting/tie_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace rilievo::reporting {
namespace {

double Percent(std::uint64_t part, std::uint64_t whole) {
  return 100 * static_cast<double>(part) / static_cast<double>(std::max<std::uint64_t>(whole, 1));
}

std::string SetText(const TieSetSummary& set) {
  return fmt::format(
      "{} tie points, {} rays (mean multiplicity {:.2f}) in {} grid cells; {} linked pairs, {} links an image at "
      "least, {} connected {}, strong pairs share {} at least\n",
      set.points, set.rays, set.points > 0 ? static_cast<double>(set.rays) / static_cast<double>(set.points) : 0,
      set.cells, set.linked_pairs, set.least_links, set.groups, set.groups == 1 ? "group" : "groups", set.least_common);
}

nlohmann::json SetJson(const TieSetSummary& set) {
  return {{"points", set.points},
          {"rays", set.rays},
          {"cells", set.cells},
          {"linked_pairs", set.linked_pairs},
          {"least_links", set.least_links},
          {"groups", set.groups},
          {"least_common", set.least_common}};
}

}  // namespace

std::string TieText(const TieSummary& ties) {
  std::string text = "Tie points\n";
  if (const TripletSummary& t = ties.triplets; t.triplets > 0)
    text += fmt::format(
        "  {} triplets ({} without three-view check, {} weak, {} images with all their matches); {} closed loops, {} "
        "dropped by the three-view check ({:.1f} %); {} of {} matches used\n",
        t.triplets, t.unchecked, t.weak, t.poor_images, t.loops, t.failed_loops, Percent(t.failed_loops, t.loops),
        t.matches_used, t.matches);
  text += "  " + SetText(ties.found);
  if (ties.is_reduced != 0)
    text += fmt::format("  reduced to {:.1f} % of the points, {:.1f} % of the cells:\n  ",
                        Percent(ties.used.points, ties.found.points), Percent(ties.used.cells, ties.found.cells)) +
            SetText(ties.used);
  return text;
}

nlohmann::json TieJson(const TieSummary& ties) {
  nlohmann::json out = {{"found", SetJson(ties.found)},
                        {"used", SetJson(ties.used)},
                        {"reduced", ties.is_reduced != 0},
                        {"triplets", nullptr}};
  if (const TripletSummary& t = ties.triplets; t.triplets > 0)
    out["triplets"] = {{"count", t.triplets},  {"unchecked", t.unchecked},
                       {"weak", t.weak},       {"poor_images", t.poor_images},
                       {"loops", t.loops},     {"failed_loops", t.failed_loops},
                       {"matches", t.matches}, {"matches_used", t.matches_used}};
  return out;
}

}  // namespace rilievo::reporting
