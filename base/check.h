// RILIEVO_CHECK: a caller's bug ends the program with its place and the broken condition.
#pragma once

namespace rilievo {
[[noreturn]] void CheckFailed(const char* condition, const char* file, int line);
}  // namespace rilievo

#define RILIEVO_CHECK(condition)                                              \
  do {                                                                        \
    if (!(condition)) ::rilievo::CheckFailed(#condition, __FILE__, __LINE__); \
  } while (false)
