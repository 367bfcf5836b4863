// Parses and prints byte counts and durations.
#include "base/units.h"

#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <utility>

#include "base/error.h"

namespace rilievo {

std::uint64_t ParseBytes(std::string_view text) {
  const auto bad = [&] {
    return Error(ErrorCode::kUsage, "", "'" + std::string(text) + "' is not a memory size",
                 "write for example 4GiB, 800MiB or 2GB");
  };
  double number = 0;
  const auto [end, ec] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (ec != std::errc{} || !std::isfinite(number) || number <= 0) throw bad();
  std::string unit;
  for (const char* c = end; c != text.data() + text.size(); ++c)
    if (*c != ' ') unit += static_cast<char>(std::tolower(static_cast<unsigned char>(*c)));
  static constexpr std::array<std::pair<std::string_view, double>, 12> kUnits{{{"", 1},
                                                                               {"b", 1},
                                                                               {"kib", 1024.0},
                                                                               {"mib", 1048576.0},
                                                                               {"gib", 1073741824.0},
                                                                               {"tib", 1099511627776.0},
                                                                               {"kb", 1e3},
                                                                               {"mb", 1e6},
                                                                               {"gb", 1e9},
                                                                               {"tb", 1e12},
                                                                               {"g", 1073741824.0},
                                                                               {"m", 1048576.0}}};
  for (const auto& [name, factor] : kUnits) {
    if (unit != name) continue;
    const double bytes = number * factor;
    if (bytes < 1 || bytes > 9e18) throw bad();
    return static_cast<std::uint64_t>(bytes);
  }
  throw bad();
}

std::string FormatBytes(std::uint64_t bytes) {
  static constexpr std::array<const char*, 5> kNames{"B", "KiB", "MiB", "GiB", "TiB"};
  double value = static_cast<double>(bytes);
  std::size_t unit = 0;
  while (value >= 1024 && unit + 1 < kNames.size()) value /= 1024, ++unit;
  char text[32];
  std::snprintf(text, sizeof text, (unit == 0 || value >= 100) ? "%.0f %s" : "%.1f %s", value, kNames[unit]);
  return text;
}

std::string FormatDuration(double seconds_s) {
  char text[48];
  if (seconds_s < 60) {
    std::snprintf(text, sizeof text, "%.1f s", seconds_s);
    return text;
  }
  const auto whole_s = static_cast<long long>(std::llround(seconds_s));
  if (whole_s < 3600)
    std::snprintf(text, sizeof text, "%lld min %02lld s", whole_s / 60, whole_s % 60);
  else
    std::snprintf(text, sizeof text, "%lld h %02lld min", whole_s / 3600, whole_s % 3600 / 60);
  return text;
}

}  // namespace rilievo
