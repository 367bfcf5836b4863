// Composes the one-line text of an Error.
#include "base/error.h"

#include <algorithm>
#include <utility>

namespace rilievo {

Error::Error(ErrorCode code, std::string path, std::string message, std::string hint)
    : code_(code), path_(std::move(path)), message_(std::move(message)), hint_(std::move(hint)) {
  if (!path_.empty()) line_ = path_ + ": ";
  line_ += message_;
  if (!hint_.empty()) line_ += " (" + hint_ + ")";
  std::replace(line_.begin(), line_.end(), '\n', ' ');
}

}  // namespace rilievo
