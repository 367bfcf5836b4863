// Temporary file, write loop, fsync, rename, fsync of the folder.
#include "engine/durable_write.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <random>
#include <utility>

#include "base/hash.h"

namespace rilievo::engine {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kTemporaryMark = ".tmp-";

class FileDescriptor {
 public:
  explicit FileDescriptor(int fd) : fd_(fd) {}
  ~FileDescriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;
  int get() const { return fd_; }
  /// Closes and says whether that went well: a network disk reports a failed write only here.
  bool Close() { return ::close(std::exchange(fd_, -1)) == 0; }

 private:
  int fd_;
};

/// Eight hexadecimal digits that differ from machine to machine: process ids mean something on their own machine only.
std::string MachineMark() {
  std::array<char, 256> name{};
  if (::gethostname(name.data(), name.size() - 1) != 0) name[0] = '?';
  const auto hash = Checksum(std::as_bytes(std::span(name.data(), std::strlen(name.data()))));
  char text[16];
  std::snprintf(text, sizeof text, "%08x", static_cast<unsigned>(hash & 0xffffffffu));
  return text;
}

fs::path TemporaryFor(const fs::path& path) {
  static std::atomic<unsigned> counter{0};
  std::random_device random;
  char text[64];
  std::snprintf(text, sizeof text, "-%ld-%u-%08x", static_cast<long>(::getpid()), counter.fetch_add(1), random());
  // The name is cut: the longest name a file system takes is 255 bytes.
  return path.parent_path() /
         (path.filename().string().substr(0, 160) + std::string(kTemporaryMark) + MachineMark() + text);
}

/// The reason of a failure, 0 for none.
int WriteAll(int fd, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(fd, bytes.data(), std::min<std::size_t>(bytes.size(), std::size_t{1} << 30));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return errno;
    if (n == 0) return ENOSPC;
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
  return 0;
}

int Sync(int fd) {
  int result = 0;
  do result = ::fsync(fd);
  while (result != 0 && errno == EINTR);
  // EINVAL: a thing that cannot be synchronised, such as a folder of some network file systems or a pipe.
  return result == 0 || errno == EINVAL ? 0 : errno;
}

void SyncFolder(const fs::path& folder) {
  const fs::path place = folder.empty() ? fs::path(".") : folder;
  FileDescriptor fd(::open(place.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (fd.get() < 0) throw DiskError(errno, place, "folder cannot be opened");
  if (const int reason = Sync(fd.get())) throw DiskError(reason, place, "folder cannot be synchronised");
}

}  // namespace

Error DiskError(int reason, const fs::path& path, const std::string& what_failed) {
  const std::string message = what_failed + ": " + std::strerror(reason);
  switch (reason) {
    case ENOSPC:
    case EDQUOT:
      return Error(ErrorCode::kDiskFull, path.string(), message,
                   "free disk space or choose a folder on another disk, then run again");
    case EFBIG:
      return Error(ErrorCode::kDiskFull, path.string(), message,
                   "raise the limit of file sizes (ulimit -f), then run again");
    case EROFS:
      return Error(ErrorCode::kIo, path.string(), message,
                   "the disk is mounted read-only: choose a folder on another disk");
    case EACCES:
    case EPERM:
      return Error(ErrorCode::kIo, path.string(), message, "check the permissions or choose another folder");
    case ENOTDIR:
    case ENOENT:
      return Error(ErrorCode::kIo, path.string(), message, "check that the folder exists and is a folder");
    default:
      return Error(ErrorCode::kIo, path.string(), message, "check the disk");
  }
}

void WritePartsDurably(const fs::path& path, std::initializer_list<std::span<const std::byte>> parts) {
  const fs::path temporary = TemporaryFor(path);
  FileDescriptor fd(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
  if (fd.get() < 0) throw DiskError(errno, path, "cannot be created");
  const auto fail = [&](int reason) {
    ::unlink(temporary.c_str());
    return DiskError(reason, path, "cannot be written");
  };
  for (const auto part : parts)
    if (const int reason = WriteAll(fd.get(), part)) throw fail(reason);
  if (const int reason = Sync(fd.get())) throw fail(reason);
  if (!fd.Close()) throw fail(errno);
  if (::rename(temporary.c_str(), path.c_str()) != 0) throw fail(errno);
  SyncFolder(path.parent_path());
}

void CreateFolderDurably(const fs::path& folder) {
  if (folder.empty()) return;
  std::error_code ignored;
  if (fs::is_directory(folder, ignored)) return;
  const fs::path parent = folder.has_filename() ? folder.parent_path() : folder.parent_path().parent_path();
  if (parent != folder) CreateFolderDurably(parent);
  if (::mkdir(folder.c_str(), 0777) == 0) return SyncFolder(parent);
  const int reason = errno;
  if (!fs::is_directory(folder, ignored)) throw DiskError(reason, folder, "folder cannot be created");
}

bool IsStaleTemporary(const fs::path& path) {
  const std::string name = path.filename().string();
  const auto mark = name.rfind(kTemporaryMark);
  if (mark == std::string::npos) return false;
  char machine[9] = {};
  long process = 0;
  unsigned counter = 0, random = 0;
  int length = 0;
  const std::string rest = name.substr(mark + kTemporaryMark.size());
  if (std::sscanf(rest.c_str(), "%8[0-9a-f]-%ld-%u-%8x%n", machine, &process, &counter, &random, &length) != 4)
    return false;
  if (static_cast<std::size_t>(length) != rest.size() || process <= 0) return false;
  const bool writer_is_dead = machine == MachineMark() && ::kill(static_cast<pid_t>(process), 0) != 0 && errno == ESRCH;
  if (writer_is_dead) return true;
  std::error_code failed;
  const auto written = fs::last_write_time(path, failed);
  return !failed && fs::file_time_type::clock::now() - written > std::chrono::hours(24);
}

}  // namespace rilievo::engine
