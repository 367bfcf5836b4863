// Who uses a workspace: runs beside one another, or one program that removes things.
#pragma once

#include <filesystem>
#include <optional>
#include <utility>

namespace rilievo::scheduling {

/// An advisory lock (flock) on the workspace folder itself: nothing is left behind by a program that was killed. Runs
/// share it, so that several may work in one workspace; `clean` wants it alone.
class WorkspaceLock {
 public:
  /// Waits while the workspace is being cleaned; calls `on_wait` once before it does. Where the disk has no such locks
  /// the run goes on without.
  template <class OnWait>
  static WorkspaceLock Share(const std::filesystem::path& dir, OnWait&& on_wait) {
    WorkspaceLock lock = TryShare(dir);
    if (lock.is_held_elsewhere_) {
      on_wait();
      lock.WaitToShare();
    }
    return lock;
  }
  /// None while a program uses the workspace. Throws Error(kIo) where the disk cannot tell.
  static std::optional<WorkspaceLock> TryAlone(const std::filesystem::path& dir);

  WorkspaceLock(WorkspaceLock&& other) noexcept
      : fd_(std::exchange(other.fd_, -1)), is_held_elsewhere_(other.is_held_elsewhere_) {}
  WorkspaceLock& operator=(WorkspaceLock&&) = delete;
  ~WorkspaceLock();

 private:
  explicit WorkspaceLock(int fd) : fd_(fd) {}
  static WorkspaceLock TryShare(const std::filesystem::path& dir);
  void WaitToShare() const;

  int fd_ = -1;
  bool is_held_elsewhere_ = false;
};

}  // namespace rilievo::scheduling
