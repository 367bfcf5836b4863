// Ends the program on a broken precondition.
#include "base/check.h"

#include <cstdio>
#include <cstdlib>

namespace rilievo {

void CheckFailed(const char* condition, const char* file, int line) {
  std::fprintf(stderr, "rilievo: internal error: check '%s' failed at %s:%d\n", condition, file, line);
  std::abort();
}

}  // namespace rilievo
