// Preloaded into the program (LD_PRELOAD): makes one system call of the publish path fail, or ends the program there.
//
// Counted, in the order they happen: open for writing and of folders, write, fsync, close of what these opened, rename,
// unlink and mkdir, all below RILIEVO_FAULT_UNDER (an absolute path). The call of number RILIEVO_FAULT_CALL (from 1)
// suffers RILIEVO_FAULT_KIND:
//   EIO, ENOSPC, EINTR   fails with that reason; nothing is done but that close closes
//   short                write: half of the bytes (other calls: nothing happens)
//   partial              write: half of the bytes, and the next write fails with ENOSPC (other calls: ENOSPC)
//   kill                 SIGKILL just before the call
//   full                 this and every later open with O_CREAT, write and mkdir fails with ENOSPC
// RILIEVO_FAULT_LOG gets a line for every counted call ("open PATH"), with "!" before the one that suffered.
// RILIEVO_FAULT_TIMES gets, when the program ends, the seconds that all threads together spent in these calls and in
// opening, reading and closing other files below the folder.
#include <dlfcn.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

namespace {

enum class Kind { kNone, kFail, kShort, kPartial, kKill, kFull };

struct Settings {
  std::string under;
  long call = 0;
  Kind kind = Kind::kNone;
  int reason = ENOSPC;
  int log_fd = -1;
};

std::string Variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

Settings ReadSettings() {
  Settings s;
  s.under = Variable("RILIEVO_FAULT_UNDER");
  if (s.under.empty()) return s;
  s.under += '/';
  s.call = std::atol(Variable("RILIEVO_FAULT_CALL").c_str());
  const std::string kind = Variable("RILIEVO_FAULT_KIND");
  if (kind == "EIO" || kind == "ENOSPC" || kind == "EINTR") {
    s.kind = Kind::kFail;
    s.reason = kind == "EIO" ? EIO : kind == "EINTR" ? EINTR : ENOSPC;
  } else if (kind == "short") {
    s.kind = Kind::kShort;
  } else if (kind == "partial") {
    s.kind = Kind::kPartial;
  } else if (kind == "kill") {
    s.kind = Kind::kKill;
  } else if (kind == "full") {
    s.kind = Kind::kFull;
  }
  const std::string log = Variable("RILIEVO_FAULT_LOG");
  if (!log.empty())
    s.log_fd =
        static_cast<int>(syscall(SYS_openat, AT_FDCWD, log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666));
  return s;
}

/// Leaked on purpose: calls come until the very end of the program.
const Settings& TheSettings() {
  static const Settings* const settings = new Settings(ReadSettings());
  return *settings;
}

std::atomic<long> spent_ns{0};

/// Adds the time until its end to `spent_ns`.
class Clock {
 public:
  ~Clock() { spent_ns += Now_ns() - start_ns_; }

 private:
  static long Now_ns() {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1'000'000'000L + now.tv_nsec;
  }
  long start_ns_ = Now_ns();
};

constexpr int kMostFiles = 65536;
enum Use : std::uint8_t { kOther, kTimed, kCounted };
std::array<std::atomic<Use>, kMostFiles> uses;
std::atomic<long> calls{0};
std::atomic<int> half_written_fd{-1};

Use UseOf(int fd) { return fd >= 0 && fd < kMostFiles ? uses[static_cast<std::size_t>(fd)].load() : kOther; }
bool IsUnder(const char* path) {
  const Settings& s = TheSettings();
  return !s.under.empty() && path != nullptr && (std::string(path) + "/").starts_with(s.under);
}

/// What becomes of one call: kNone = it is done as asked.
Kind Count(const char* name, const char* path, bool takes_space) {
  const Settings& s = TheSettings();
  const long number = ++calls;
  const bool is_hit = s.kind == Kind::kFull ? s.call > 0 && number >= s.call && takes_space : number == s.call;
  if (s.log_fd >= 0) {
    const std::string line = std::string(is_hit ? "!" : "") + name + " " + path + "\n";
    if (syscall(SYS_write, s.log_fd, line.data(), line.size()) < 0) std::abort();
  }
  if (is_hit && s.kind == Kind::kKill) kill(getpid(), SIGKILL);
  return is_hit ? s.kind : Kind::kNone;
}

/// True when the call fails, with errno set.
bool Fails(const char* name, const char* path, bool takes_space = false) {
  const Kind kind = Count(name, path, takes_space);
  if (kind == Kind::kNone || kind == Kind::kShort) return false;
  errno = kind == Kind::kFail ? TheSettings().reason : ENOSPC;
  return true;
}

template <class Function>
Function* Real(Function*, const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}
#define REAL(function) Real(static_cast<decltype(&::function)>(nullptr), #function)

int Open(const char* path, int flags, mode_t mode) {
  const bool is_under = IsUnder(path), counts = is_under && (flags & (O_WRONLY | O_RDWR | O_DIRECTORY)) != 0;
  if (counts && Fails((flags & O_DIRECTORY) != 0 ? "open-folder" : "open", path, (flags & O_CREAT) != 0)) return -1;
  const Clock clock;
  const int fd = static_cast<int>(syscall(SYS_openat, AT_FDCWD, path, flags, mode));
  if (fd >= 0 && fd < kMostFiles) uses[static_cast<std::size_t>(fd)] = counts ? kCounted : is_under ? kTimed : kOther;
  return fd;
}

int OpenWithMode(const char* path, int flags, va_list arguments) {
  return Open(path, flags, (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(arguments, mode_t) : 0);
}

}  // namespace

extern "C" {

int open(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const int fd = OpenWithMode(path, flags, arguments);
  va_end(arguments);
  return fd;
}

int open64(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const int fd = OpenWithMode(path, flags, arguments);
  va_end(arguments);
  return fd;
}

ssize_t read(int fd, void* data, size_t size) {
  static const auto real = REAL(read);
  if (UseOf(fd) == kOther) return real(fd, data, size);
  const Clock clock;
  return real(fd, data, size);
}

ssize_t write(int fd, const void* data, size_t size) {
  static const auto real = REAL(write);
  if (UseOf(fd) != kCounted) return real(fd, data, size);
  const Clock clock;
  const Kind kind = Count("write", "", true);
  if (half_written_fd == fd) {
    half_written_fd = -1;
    errno = ENOSPC;
    return -1;
  }
  if (kind == Kind::kNone) return real(fd, data, size);
  if (kind == Kind::kShort || (kind == Kind::kPartial && size > 1)) {
    if (kind == Kind::kPartial) half_written_fd = fd;
    return real(fd, data, size > 1 ? size / 2 : size);
  }
  errno = kind == Kind::kFail ? TheSettings().reason : ENOSPC;
  return -1;
}

int fsync(int fd) {
  static const auto real = REAL(fsync);
  const Clock clock;
  return UseOf(fd) == kCounted && Fails("fsync", "") ? -1 : real(fd);
}

int close(int fd) {
  static const auto real = REAL(close);
  const Use use = UseOf(fd);
  if (use == kOther) return real(fd);
  const Clock clock;
  uses[static_cast<std::size_t>(fd)] = kOther;
  const bool fails = use == kCounted && Fails("close", "");
  const int reason = errno;
  const int result = real(fd);
  if (!fails) return result;
  errno = reason;
  return -1;
}

int rename(const char* from, const char* to) noexcept {
  static const auto real = REAL(rename);
  const Clock clock;
  return IsUnder(to) && Fails("rename", to) ? -1 : real(from, to);
}

int unlink(const char* path) noexcept {
  static const auto real = REAL(unlink);
  const Clock clock;
  return IsUnder(path) && Fails("unlink", path) ? -1 : real(path);
}

int remove(const char* path) noexcept {
  static const auto real = REAL(remove);
  const Clock clock;
  return IsUnder(path) && Fails("unlink", path) ? -1 : real(path);
}

int mkdir(const char* path, mode_t mode) noexcept {
  static const auto real = REAL(mkdir);
  const Clock clock;
  return IsUnder(path) && Fails("mkdir", path, true) ? -1 : real(path, mode);
}

__attribute__((destructor)) static void WriteTimes() {
  const std::string path = Variable("RILIEVO_FAULT_TIMES");
  if (path.empty()) return;
  const long fd = syscall(SYS_openat, AT_FDCWD, path.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666);
  const std::string text = std::to_string(static_cast<double>(spent_ns) * 1e-9) + "\n";
  if (syscall(SYS_write, fd, text.data(), text.size()) < 0) std::abort();
}

}  // extern "C"
