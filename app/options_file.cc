// Reads --options FILE into the options of a command.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <toml.hpp>

#include "app/command.h"
#include "base/error.h"

namespace rilievo::app {
namespace {

std::string ValueText(const toml::value& value, const std::string& where) {
  if (value.is_string()) return value.as_string().str;
  if (value.is_boolean()) return value.as_boolean() ? "true" : "false";
  if (value.is_integer()) return std::to_string(value.as_integer());
  if (value.is_floating()) return fmt::format("{}", value.as_floating());
  throw Error(ErrorCode::kUsage, where, "is not a text, number or true/false");
}

}  // namespace

void AddOptionsFile(CLI::App& command, std::string& path) {
  command
      .add_option("--options", path,
                  "TOML file that sets any of these options, a line each: name = value; the command line goes first")
      ->type_name("FILE")
      ->group("Run");
}

void ApplyOptionsFile(CLI::App& command, const std::string& path) {
  if (path.empty()) return;
  if (!std::filesystem::is_regular_file(path))
    throw Error(ErrorCode::kUsage, path, "there is no such options file", "--options takes a TOML file");
  toml::value content;
  try {
    content = toml::parse(path);
  } catch (const std::exception& error) {
    throw Error(ErrorCode::kUsage, path, std::string("is not TOML: ") + error.what(),
                "write name = value, a line each");
  }
  for (const auto& [name, value] : content.as_table()) {
    const std::string where = path + ": " + name;
    CLI::Option* option = name == "options" ? nullptr : command.get_option_no_throw("--" + name);
    if (option == nullptr)
      throw Error(ErrorCode::kUsage, where, "is not an option of this command",
                  "see rilievo " + command.get_name() + " --help");
    if (option->count() > 0) continue;
    try {
      option->add_result(ValueText(value, where));
      option->run_callback();
    } catch (const CLI::ParseError& error) {
      throw Error(ErrorCode::kUsage, where, error.what());
    } catch (const Error& error) {
      throw Error(ErrorCode::kUsage, where, error.what());
    }
  }
}

}  // namespace rilievo::app
