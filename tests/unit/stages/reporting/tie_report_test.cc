// Counts of tie points in the report: every figure in both forms, and nothing that did not happen.
#include "stages/reporting/tie_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace rilievo::reporting {
namespace {

using testing::HasSubstr;
using testing::Not;

TieSummary Example() {
  TieSummary ties;
  ties.triplets = {.triplets = 31,
                   .unchecked = 2,
                   .weak = 3,
                   .poor_images = 4,
                   .loops = 5000,
                   .failed_loops = 250,
                   .matches = 16000,
                   .matches_used = 12000};
  ties.found = {.points = 4000,
                .rays = 14000,
                .cells = 900,
                .linked_pairs = 61,
                .least_common = 44,
                .least_links = 2,
                .groups = 1};
  ties.used = {
      .points = 600, .rays = 3000, .cells = 870, .linked_pairs = 60, .least_common = 12, .least_links = 1, .groups = 2};
  ties.is_reduced = 1;
  return ties;
}

TEST(TieReport, SaysWhatASequenceAndAReductionDid) {
  const std::string text = TieText(Example());
  for (const char* words :
       {"31 triplets", "2 without three-view check", "3 weak", "4 images with all", "5000 closed loops",
        "250 dropped by the three-view check (5.0 %)", "12000 of 16000 matches", "4000 tie points, 14000 rays", "3.50",
        "900 grid cells", "61 linked pairs", "reduced to 15.0 % of the points, 96.7 % of the cells", "600 tie points",
        "2 connected groups", "share 12 at least"})
    EXPECT_THAT(text, HasSubstr(words));
  const nlohmann::json json = TieJson(Example());
  EXPECT_EQ(json["triplets"]["count"], 31);
  EXPECT_EQ(json["triplets"]["failed_loops"], 250);
  EXPECT_EQ(json["triplets"]["matches_used"], 12000);
  EXPECT_EQ(json["found"]["points"], 4000);
  EXPECT_EQ(json["used"]["cells"], 870);
  EXPECT_EQ(json["used"]["least_common"], 12);
  EXPECT_EQ(json["reduced"], true);
}

TEST(TieReport, SaysNothingOfWhatWasNotDone) {
  TieSummary ties = Example();
  ties.triplets = {};
  ties.is_reduced = 0;
  ties.used = ties.found;
  EXPECT_THAT(TieText(ties), Not(HasSubstr("triplet")));
  EXPECT_THAT(TieText(ties), Not(HasSubstr("reduced")));
  EXPECT_TRUE(TieJson(ties)["triplets"].is_null());
  EXPECT_EQ(TieJson(ties)["reduced"], false);
  EXPECT_THAT(TieText(TieSummary{}), HasSubstr("0 tie points"));
}

}  // namespace
}  // namespace rilievo::reporting
