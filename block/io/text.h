// Text files read whole, cut into lines and numbers without regard to the locale.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace rilievo::io {

/// The bytes of a file. Throws Error(kNotFound / kUnreadable), also for a folder and for more than `max_bytes`.
std::string ReadWholeFile(const std::filesystem::path& path, std::size_t max_bytes = std::size_t{1} << 33);

/// A line without its end (\n or \r\n) and surrounding blanks, and its number (from 1).
struct TextLine {
  std::size_t number = 0;
  std::string_view text;
};

/// Views into `text`, which must outlive them; a byte order mark is dropped. Empty lines are kept.
std::vector<TextLine> SplitLines(std::string_view text);

/// The pieces between any of `separators`, empty ones dropped.
std::vector<std::string_view> SplitTokens(std::string_view text, std::string_view separators = " \t");

std::string_view Trim(std::string_view text);

/// The whole of `token` as a finite number; none otherwise ("nan", "inf", "1,5", "12px").
std::optional<double> ParseFinite(std::string_view token);
std::optional<long long> ParseInteger(std::string_view token);

/// Shortest decimal text that reads back as the same double.
std::string ExactText(double value);

}  // namespace rilievo::io
