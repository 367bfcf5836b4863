// Declares a stage's options once: validation, artifact keys, command line, TOML and documentation read the
// declaration.
#pragma once

#include <charconv>
#include <cstdio>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <variant>
#include <vector>

#include "base/error.h"

namespace rilievo {

/// One option of the options struct S. `name` is the command-line spelling without dashes, in kebab case.
template <class S>
struct OptionDeclaration {
  using Member = std::variant<bool S::*, int S::*, double S::*, std::string S::*>;
  std::string_view name;
  Member member;
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  std::string_view unit;
  std::string_view help;
  std::vector<std::string_view> choices = {};  ///< for strings: the values allowed; empty = any
};

/// Canonical text of one value: decimal integers, shortest round-trip doubles, true/false.
template <class S>
std::string OptionValueText(const S& options, const OptionDeclaration<S>& declaration) {
  return std::visit(
      [&](auto member) -> std::string {
        using T = std::remove_cvref_t<decltype(options.*member)>;
        if constexpr (std::is_same_v<T, bool>) {
          return (options.*member) ? "true" : "false";
        } else if constexpr (std::is_same_v<T, std::string>) {
          return options.*member;
        } else if constexpr (std::is_same_v<T, int>) {
          return std::to_string(options.*member);
        } else {
          char text[40];
          for (int digits = 6; digits <= 17; ++digits) {
            std::snprintf(text, sizeof text, "%.*g", digits, options.*member);
            double back = 0;
            if (std::sscanf(text, "%lf", &back) == 1 && back == options.*member) break;
          }
          return text;
        }
      },
      declaration.member);
}

/// Sets one option from its text; throws Error(kUsage) when the text is not a value of its type. The range is checked
/// by ValidateOptions.
template <class S>
void SetOptionValue(S& options, const OptionDeclaration<S>& declaration, const std::string& text) {
  const auto bad = [&](const char* type) {
    return Error(ErrorCode::kUsage, "--" + std::string(declaration.name), "'" + text + "' is not " + type);
  };
  std::visit(
      [&](auto member) {
        using T = std::remove_cvref_t<decltype(options.*member)>;
        if constexpr (std::is_same_v<T, bool>) {
          if (text != "true" && text != "false") throw bad("true or false");
          options.*member = text == "true";
        } else if constexpr (std::is_same_v<T, std::string>) {
          options.*member = text;
        } else {
          T value{};
          const auto [end, ec] = std::from_chars(text.data(), text.data() + text.size(), value);
          if (ec != std::errc{} || end != text.data() + text.size())
            throw bad(std::is_same_v<T, int> ? "a whole number" : "a number");
          options.*member = value;
        }
      },
      declaration.member);
}

/// "name=value\n" for every option, in the order of declaration: part of artifact keys.
template <class S>
std::string OptionKeyText(const S& options, std::span<const OptionDeclaration<S>> declarations) {
  std::string text;
  for (const auto& d : declarations) text += std::string(d.name) + "=" + OptionValueText(options, d) + "\n";
  return text;
}

/// Throws Error(kUsage) naming the first option out of its range.
template <class S>
void ValidateOptions(const S& options, std::span<const OptionDeclaration<S>> declarations) {
  for (const auto& d : declarations) {
    std::visit(
        [&](auto member) {
          using T = std::remove_cvref_t<decltype(options.*member)>;
          const std::string where = "--" + std::string(d.name);
          if constexpr (std::is_same_v<T, std::string>) {
            if (d.choices.empty()) return;
            std::string list;
            for (const auto choice : d.choices) {
              if (choice == options.*member) return;
              list += (list.empty() ? "" : ", ") + std::string(choice);
            }
            throw Error(ErrorCode::kUsage, where, "'" + options.*member + "' is not a value it takes",
                        "use one of " + list);
          } else if constexpr (!std::is_same_v<T, bool>) {
            const double value = static_cast<double>(options.*member);
            if (value >= d.min && value <= d.max) return;
            char range[96];
            std::snprintf(range, sizeof range, "use a value from %g to %g", d.min, d.max);
            throw Error(ErrorCode::kUsage, where, OptionValueText(options, d) + " is out of range", range);
          }
        },
        d.member);
  }
}

}  // namespace rilievo
