// Files that are there whole or not at all, whatever happens meanwhile.
#pragma once

#include <cstddef>
#include <filesystem>
#include <initializer_list>
#include <span>
#include <string>

#include "base/error.h"

namespace rilievo::engine {

/// Writes the parts, one after another, to a temporary file beside `path`, then fsync, rename, fsync of the folder. A
/// reader sees the old file or the new one. Throws Error(kDiskFull / kIo); the temporary is removed then.
void WritePartsDurably(const std::filesystem::path& path, std::initializer_list<std::span<const std::byte>> parts);

/// Creates the folder and its parents, durably. Throws Error(kDiskFull / kIo).
void CreateFolderDurably(const std::filesystem::path& folder);

/// True for a temporary of WritePartsDurably whose writer is gone (dead process of this machine, or a day old).
bool IsStaleTemporary(const std::filesystem::path& path);

/// The error of a failed system call, with what to do about it.
Error DiskError(int reason, const std::filesystem::path& path, const std::string& what_failed);

}  // namespace rilievo::engine
