// A command of the program: its flags and what it does. One file a command implements Add...Command.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>

#include "engine/executor.h"

namespace CLI {
class App;
}

namespace rilievo::app {

enum ExitCode { kExitDone = 0, kExitFailed = 1, kExitUsage = 2, kExitCancelled = 130 };

/// What every command gets from main. Outlives every thread that looks at it.
struct ProgramContext {
  std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
  engine::StopSource stop;
  int exit_code = kExitDone;               ///< set by the command that ran
  std::atomic<bool> json_messages{false};  ///< --progress json: warnings and errors are JSON lines; read by any thread
  std::atomic<bool> cancel_told{false};    ///< whoever ends a cancelled run first says so, once
  std::mutex before_exit_mutex;            ///< guards before_exit
  std::function<void()> before_exit;       ///< what a cancelled program still does: writing its trace
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

}  // namespace rilievo::app
