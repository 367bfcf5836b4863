// Measures exact matching beside libraries and the peak of its instruction: one sub-command, one JSON object on stdout.
#include <string>
#include <vector>

#include "bench/accuracy/eval_main.h"
#include "bench/accuracy/m2_eval.h"

namespace rilievo::bench {
namespace {

constexpr const char* kUsage =
    "usage: m2_eval speed COUNT REPEATS IMAGE...\n"
    "       m2_eval peer NAME COUNT REPEATS IMAGE...\n"
    "       m2_eval scaling IMAGE...\n";

Json Dispatch(const std::vector<std::string>& words) {
  const auto images_from = [&](std::size_t i) {
    return std::vector<std::string>(words.begin() + static_cast<std::ptrdiff_t>(i), words.end());
  };
  if (words.size() >= 5 && words[0] == "speed")
    return MeasureM2(static_cast<std::size_t>(std::stoul(words[1])), std::stoi(words[2]), images_from(3));
  if (words.size() >= 6 && words[0] == "peer")
    return MeasurePeer(words[1], static_cast<std::size_t>(std::stoul(words[2])), std::stoi(words[3]), images_from(4));
  if (words.size() >= 3 && words[0] == "scaling") return MeasurePairScaling(images_from(1));
  return nullptr;
}

}  // namespace
}  // namespace rilievo::bench

int main(int argc, char** argv) {
  return rilievo::bench::EvalMain("m2_eval", rilievo::bench::kUsage, rilievo::bench::Dispatch, argc, argv);
}
