// Measures the ways to match beside each other: one sub-command, one JSON object on stdout.
#include "bench/accuracy/matching_eval.h"
#include "bench/accuracy/eval_main.h"

#include <algorithm>
#include <iterator>

#include "bench/accuracy/features_clock.h"

namespace rilievo::bench {
namespace {

constexpr const char* kUsage =
    "usage: matching_eval row WIDTH HEIGHT FEATURES_A FEATURES_B CHECKS [exact]\n"
    "       matching_eval large FEATURES IMAGE_A IMAGE_B [IMAGE_A IMAGE_B]...\n";
constexpr int kRepeats = 5;
constexpr double kLong_s = 2;

Json Dispatch(const std::vector<std::string>& words) {
  const std::size_t n = words.size();
  if ((n == 6 || (n == 7 && words[6] == "exact")) && words[0] == "row")
    return MeasureTableRow(std::stoi(words[1]), std::stoi(words[2]), std::stoul(words[3]), std::stoul(words[4]),
                           std::stoi(words[5]), n == 7);
  if (n >= 4 && n % 2 == 0 && words[0] == "large")
    return MeasureLarge(std::stoul(words[1]), {words.begin() + 2, words.end()});
  return nullptr;
}

}  // namespace

Timed MatchTimed(std::span<const Descriptor> a, std::span<const Descriptor> b, const matching::Options& options) {
  SerialRunContext context;
  Timed timed;
  for (int i = 0; i < kRepeats; ++i) {
    const double cpu_s = TimeOf([&] { timed.matches = matching::Run(a, b, options, context); }).cpu_s;
    timed.cpu_s = i == 0 ? cpu_s : std::min(timed.cpu_s, cpu_s);
    if (cpu_s > kLong_s) break;
  }
  return timed;
}

Json BesideReference(const Timed& timed, const Timed& reference) {
  std::vector<Match> common;
  std::set_intersection(timed.matches.begin(), timed.matches.end(), reference.matches.begin(), reference.matches.end(),
                        std::back_inserter(common));
  const auto whole = static_cast<double>(std::max<std::size_t>(1, reference.matches.size()));
  return {{"matches", timed.matches.size()},
          {"recall", static_cast<double>(common.size()) / whole},
          {"extra", static_cast<double>(timed.matches.size() - common.size()) / whole},
          {"cpu_s", timed.cpu_s}};
}

}  // namespace rilievo::bench

int main(int argc, char** argv) {
  return rilievo::bench::EvalMain("matching_eval", rilievo::bench::kUsage, rilievo::bench::Dispatch, argc, argv);
}
