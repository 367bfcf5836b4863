// flock on a folder.
#include "scheduling/workspace_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "base/error.h"

namespace rilievo::scheduling {
namespace {

int Lock(int fd, int how) {
  int result = 0;
  do result = ::flock(fd, how);
  while (result != 0 && errno == EINTR);
  return result;
}

}  // namespace

WorkspaceLock::~WorkspaceLock() {
  if (fd_ >= 0) ::close(fd_);
}

WorkspaceLock WorkspaceLock::TryShare(const std::filesystem::path& dir) {
  WorkspaceLock lock(::open(dir.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  lock.is_held_elsewhere_ = lock.fd_ >= 0 && Lock(lock.fd_, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  return lock;
}

void WorkspaceLock::WaitToShare() const { Lock(fd_, LOCK_SH); }

std::optional<WorkspaceLock> WorkspaceLock::TryAlone(const std::filesystem::path& dir) {
  WorkspaceLock lock(::open(dir.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (lock.fd_ >= 0 && Lock(lock.fd_, LOCK_EX | LOCK_NB) == 0) return lock;
  if (lock.fd_ >= 0 && errno == EWOULDBLOCK) return std::nullopt;
  throw Error(ErrorCode::kIo, dir.string(),
              std::string("cannot be locked, so that nothing tells whether a run uses it: ") + std::strerror(errno),
              "make sure that no run uses it and clean it on the machine whose disk it is");
}

}  // namespace rilievo::scheduling
