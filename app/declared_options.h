// The flags of options that a stage declares.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdio>
#include <span>
#include <string>
#include <variant>

#include "base/option.h"

namespace rilievo::app {

/// Makes each declared option a flag; the help shows unit, range and default.
template <class S>
void AddDeclaredOptions(CLI::App& command, S& options, std::span<const OptionDeclaration<S>> declarations,
                        const std::string& group) {
  for (const auto& d : declarations) {
    std::string help(d.help);
    if (!d.unit.empty()) help += " [" + std::string(d.unit) + "]";
    if (!d.choices.empty()) {
      help += " (";
      for (std::size_t i = 0; i < d.choices.size(); ++i) help += (i ? ", " : "") + std::string(d.choices[i]);
      help += ")";
    } else if (!std::holds_alternative<bool S::*>(d.member) && d.min > -1e300 && d.max < 1e300) {
      char range[80];
      std::snprintf(range, sizeof range, " (%.10g to %.10g)", d.min, d.max);
      help += range;
    }
    const bool is_switch = std::holds_alternative<bool S::*>(d.member);
    const auto set = [&options, d, is_switch](const std::string& text) {
      SetOptionValue(options, d, is_switch && text.empty() ? "true" : text);
    };
    CLI::Option* option = command.add_option_function<std::string>("--" + std::string(d.name), set, help)->group(group);
    if (is_switch)  // given alone, CLI11 hands over the default string: kept empty, it means true
      option->expected(0, 1)->type_name("true|false=" + OptionValueText(options, d));
    else
      option->default_str(OptionValueText(options, d))->type_name("VALUE");
  }
}

}  // namespace rilievo::app
