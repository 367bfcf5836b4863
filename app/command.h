// A command of the program: its flags and what it does. One file a command implements Add...Command.
#pragma once

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "base/option.h"
#include "base/units.h"
#include "engine/executor.h"

namespace rilievo::app {

enum ExitCode { kExitDone = 0, kExitFailed = 1, kExitUsage = 2, kExitCancelled = 130 };

/// What every command gets from main. Outlives every thread that looks at it.
struct ProgramContext {
  std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
  engine::StopSource stop;
  int exit_code = kExitDone;          ///< set by the command that ran
  bool json_messages = false;         ///< --progress json: warnings and errors are JSON lines too
  std::mutex before_exit_mutex;       ///< guards before_exit
  std::function<void()> before_exit;  ///< what a cancelled program still does: writing its trace
};

/// One line on stderr: "rilievo: WARNING: ..." for people, {"event": "warning", "message": ...} for programs.
void PrintWarning(const ProgramContext& context, const std::string& message);
void PrintError(const ProgramContext& context, const std::string& message);

void AddOrientCommand(CLI::App& app, ProgramContext& context);
void AddPlanCommand(CLI::App& app, ProgramContext& context);
void AddInfoCommand(CLI::App& app, ProgramContext& context);
void AddReportCommand(CLI::App& app, ProgramContext& context);
void AddExportCommand(CLI::App& app, ProgramContext& context);
void AddSimulateCommand(CLI::App& app, ProgramContext& context);
void AddFeaturesCommand(CLI::App& app, ProgramContext& context);
void AddProfileCommand(CLI::App& app, ProgramContext& context);
void AddVerifyCommand(CLI::App& app, ProgramContext& context);
void AddCleanCommand(CLI::App& app, ProgramContext& context);

/// Adds --options FILE: a TOML file that sets options of `command` by their long names. What the command line gives
/// goes first; unknown names and wrong values are errors with the file's name. Read by ApplyOptionsFile.
void AddOptionsFile(CLI::App& command, std::string& path);
void ApplyOptionsFile(CLI::App& command, const std::string& path);

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
