// Byte counts and angles as people write them.
#pragma once

#include <cstdint>
#include <numbers>
#include <string>
#include <string_view>

namespace rilievo {

inline constexpr std::uint64_t kMebibyte = std::uint64_t{1} << 20;
inline constexpr std::uint64_t kGibibyte = std::uint64_t{1} << 30;

constexpr double DegToRad(double angle_deg) { return angle_deg * std::numbers::pi / 180.0; }
constexpr double RadToDeg(double angle_rad) { return angle_rad * 180.0 / std::numbers::pi; }

/// Reads "4GiB", "512 MiB", "1.5GB", "1000000" into bytes; throws Error(kUsage) for anything else, zero included.
std::uint64_t ParseBytes(std::string_view text);

/// "3.2 GiB", "412 MiB", "17 KiB", "12 B".
std::string FormatBytes(std::uint64_t bytes);

/// "1 h 02 min", "3 min 05 s", "4.2 s".
std::string FormatDuration(double seconds_s);

}  // namespace rilievo
