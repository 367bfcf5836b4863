// Errors of a broken world (file, disk, memory, input): reported once, in one line, by the program.
#pragma once

#include <exception>
#include <string>

namespace rilievo {

enum class ErrorCode {
  kNotFound,
  kUnreadable,
  kInvalidInput,
  kUnsupported,
  kIo,
  kDiskFull,
  kOutOfMemoryBudget,
  kVersion,
  kUsage,
  kInternal
};

/// `path` is where (may be empty), `message` what, `hint` what to do. what() is the one line "path: message (hint)".
class Error : public std::exception {
 public:
  Error(ErrorCode code, std::string path, std::string message, std::string hint = {});
  ErrorCode code() const { return code_; }
  const std::string& path() const { return path_; }
  const std::string& message() const { return message_; }
  const std::string& hint() const { return hint_; }
  const char* what() const noexcept override { return line_.c_str(); }

 private:
  ErrorCode code_;
  std::string path_, message_, hint_, line_;
};

/// Thrown when work was stopped on request; never a success and never an Error.
class Cancelled : public std::exception {
 public:
  const char* what() const noexcept override { return "cancelled"; }
};

}  // namespace rilievo
