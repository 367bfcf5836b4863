// Warnings and errors on stderr, for people or for programs.
#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "app/command.h"

namespace rilievo::app {
namespace {

void PrintEvent(const char* event, const std::string& message) {
  const nlohmann::json line = {{"event", event}, {"message", message}};
  fmt::print(stderr, "{}\n", line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
}

}  // namespace

void PrintWarning(const ProgramContext& context, const std::string& message) {
  if (context.json_messages)
    PrintEvent("warning", message);
  else
    fmt::print(stderr, "rilievo: WARNING: {}\n", message);
}

void PrintError(const ProgramContext& context, const std::string& message) {
  if (context.json_messages)
    PrintEvent("error", message);
  else
    fmt::print(stderr, "rilievo: {}\n", message);
}

}  // namespace rilievo::app
