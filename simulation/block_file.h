// Files of a simulated block: under their own name they are always complete.
#pragma once

#include <filesystem>
#include <string_view>

namespace rilievo::simulation {

/// Writes NAME.PROCESS.tmp beside `path`, brings it to the disk and renames it; makes the folder. Two programs may
/// write the same file at once. Throws Error(kIo, kDiskFull).
void WriteBlockFile(const std::filesystem::path& path, std::string_view content);

/// True for the temporary of WriteBlockFile, also of a running program.
bool IsTemporary(const std::filesystem::path& path);
/// True for a temporary whose program is gone: it will never be renamed.
bool IsStaleTemporary(const std::filesystem::path& path);

}  // namespace rilievo::simulation
