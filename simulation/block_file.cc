// Temporary file, fsync, rename.
#include "simulation/block_file.h"

#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <string>
#include <system_error>

#include "base/error.h"

namespace rilievo::simulation {
namespace {

namespace fs = std::filesystem;

/// 0 when all of it is on the disk, else errno of what failed.
int WriteAll(const fs::path& path, std::string_view content) {
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (file < 0) return errno;
  int reason = 0;
  while (!content.empty() && reason == 0) {
    const ssize_t written = write(file, content.data(), content.size());
    if (written >= 0)
      content.remove_prefix(static_cast<std::size_t>(written));
    else if (errno != EINTR)
      reason = errno;
  }
  // Without it a power cut could leave an empty file under the final name.
  if (reason == 0 && fsync(file) != 0) reason = errno;
  if (close(file) != 0 && reason == 0) reason = errno;
  return reason;
}

/// The process in NAME.PROCESS.tmp; 0 when it is no such name.
int ProcessOf(const fs::path& path) {
  const std::string text = path.stem().extension().string();
  int id = 0;
  if (path.extension() != ".tmp" || text.size() < 2) return 0;
  const auto [end, error] = std::from_chars(text.data() + 1, text.data() + text.size(), id);
  return error == std::errc{} && end == text.data() + text.size() && id > 0 ? id : 0;
}

}  // namespace

void WriteBlockFile(const fs::path& path, std::string_view content) {
  std::error_code failed;
  fs::create_directories(path.parent_path(), failed);
  fs::path temporary = path;
  temporary += "." + std::to_string(getpid()) + ".tmp";
  const int reason = WriteAll(temporary, content);
  if (reason != 0)
    failed.assign(reason, std::generic_category());
  else
    fs::rename(temporary, path, failed);
  if (!failed) return;
  std::error_code ignored;
  fs::remove(temporary, ignored);
  throw Error(failed == std::errc::no_space_on_device ? ErrorCode::kDiskFull : ErrorCode::kIo, path.string(),
              "cannot be written: " + failed.message(), "check the folder's permissions and the free disk space");
}

bool IsTemporary(const fs::path& path) { return ProcessOf(path) != 0; }

bool IsStaleTemporary(const fs::path& path) {
  const int id = ProcessOf(path);
  return id != 0 && kill(id, 0) != 0 && errno == ESRCH;
}

}  // namespace rilievo::simulation
