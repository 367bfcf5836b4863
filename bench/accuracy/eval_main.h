// The main function of the evaluation programs: one sub-command in, one JSON object on stdout.
#pragma once

#include <cstdio>
#include <exception>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "stages/images/library_setup.h"

namespace rilievo::bench {

/// Prints what dispatch(words after the program's name) gives; null: the usage, exit code 2. Errors end with 1.
template <class Dispatch>
int EvalMain(const char* program, const char* usage, const Dispatch& dispatch, int argc, char** argv) {
  try {
    images::PrepareImageLibrary();
    const nlohmann::ordered_json result = dispatch(std::vector<std::string>(argv + 1, argv + argc));
    if (result.is_null()) {
      std::fputs(usage, stderr);
      return 2;
    }
    std::printf("%s\n", result.dump(1).c_str());
    return 0;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s: %s\n", program, e.what());
    return 1;
  }
}

}  // namespace rilievo::bench
