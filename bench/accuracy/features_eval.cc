// Measures the features of the stage beside OpenCV's: one sub-command, one JSON object on stdout.
#include <string>
#include <vector>

#include "bench/accuracy/eval_main.h"
#include "bench/accuracy/features_eval.h"

namespace rilievo::bench {
namespace {

constexpr const char* kUsage =
    "usage: features_eval speed IMAGE [REPEATS]\n"
    "       features_eval scaling IMAGE...\n"
    "       features_eval repeatability FOLDER\n"
    "       features_eval localisation\n"
    "       features_eval identity IMAGE DUMP\n"
    "       features_eval compare DUMP DUMP\n"
    "       features_eval descriptors FOLDER...\n"
    "       features_eval learn FOLDER\n";

Json Dispatch(const std::string& command, const std::vector<std::string>& arguments) {
  const std::size_t n = arguments.size();
  if (command == "speed" && (n == 1 || n == 2)) return MeasureSpeed(arguments[0], n == 2 ? std::stoi(arguments[1]) : 7);
  if (command == "scaling" && n >= 1) return MeasureScaling(arguments, 5);
  if (command == "repeatability" && n == 1) return MeasureRepeatability(arguments[0]);
  if (command == "localisation" && n == 0) return MeasureLocalisation();
  if (command == "identity" && n == 2) return MeasureIdentity(arguments[0], arguments[1]);
  if (command == "compare" && n == 2) return CompareDumps(arguments[0], arguments[1]);
  if (command == "descriptors") return MeasureDescriptors(arguments);
  if (command == "learn" && n == 1) return LearnProjections(arguments[0]);
  return nullptr;
}

}  // namespace
}  // namespace rilievo::bench

int main(int argc, char** argv) {
  return rilievo::bench::EvalMain(
      "features_eval", rilievo::bench::kUsage,
      [](const std::vector<std::string>& words) {
        return words.empty() ? rilievo::bench::Json(nullptr)
                             : rilievo::bench::Dispatch(words[0], {words.begin() + 1, words.end()});
      },
      argc, argv);
}
