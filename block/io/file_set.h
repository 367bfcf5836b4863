// The files of an export in memory: the caller writes them durably.
#pragma once

#include <map>
#include <string>

namespace rilievo::io {

/// Content by file name relative to the export's folder.
using FileSet = std::map<std::string, std::string>;

}  // namespace rilievo::io
