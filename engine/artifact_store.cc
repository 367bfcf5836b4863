// The file format of artifacts (docs/formats/artifact.md) and the folders they live in.
#include "engine/artifact_store.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>

#include "base/check.h"
#include "base/error.h"
#include "engine/durable_write.h"

namespace rilievo::engine {
namespace {

namespace fs = std::filesystem;

constexpr std::array<char, 8> kMagic{'R', 'I', 'L', 'I', 'E', 'V', 'O', 'A'};
constexpr std::uint32_t kFormatVersion = 1;
constexpr const char* kSuffix = ".art";
constexpr const char* kQuarantine = "quarantine";

/// As it lies on disk, little endian, without gaps.
struct Header {
  std::array<char, 8> magic = kMagic;
  std::uint32_t version = kFormatVersion;
  std::uint32_t reserved = 0;
  std::uint64_t payload_bytes = 0;
  std::uint64_t payload_checksum = 0;
  std::uint64_t header_checksum = 0;  ///< of all fields before it
};
static_assert(sizeof(Header) == 40 && offsetof(Header, header_checksum) == 32);

std::uint64_t HeaderChecksum(const Header& header) {
  return Checksum(std::as_bytes(std::span(&header, 1)).first(offsetof(Header, header_checksum)));
}

/// An artifact's file, open for reading; a failing disk throws, anything wrong with the content does not.
class ArtifactFile {
 public:
  explicit ArtifactFile(const fs::path& path) : path_(path), fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
    if (fd_ < 0 && errno != ENOENT && errno != ENOTDIR) throw DiskError(errno, path_, "cannot be opened");
  }
  ~ArtifactFile() {
    if (fd_ >= 0) ::close(fd_);
  }
  ArtifactFile(const ArtifactFile&) = delete;
  ArtifactFile& operator=(const ArtifactFile&) = delete;

  bool IsOpen() const { return fd_ >= 0; }

  /// None when the file is damaged. Throws Error(kVersion) for an intact header of another version.
  std::optional<Header> ReadHeader() {
    Header header;
    if (ReadSome(std::as_writable_bytes(std::span(&header, 1))) != sizeof header) return std::nullopt;
    if (header.magic != kMagic || header.header_checksum != HeaderChecksum(header)) return std::nullopt;
    if (header.version != kFormatVersion) {
      throw Error(ErrorCode::kVersion, path_.string(),
                  "artifact has format version " + std::to_string(header.version) + ", this program knows " +
                      std::to_string(kFormatVersion),
                  "use the program that wrote the workspace, or start a new workspace");
    }
    struct stat status {};
    if (::fstat(fd_, &status) != 0) throw DiskError(errno, path_, "cannot be read");
    const auto file_bytes = static_cast<std::uint64_t>(status.st_size);
    if (header.reserved != 0 || file_bytes < sizeof header || file_bytes - sizeof header != header.payload_bytes)
      return std::nullopt;
    return header;
  }

  /// As many bytes as there are, at most the span.
  std::size_t ReadSome(std::span<std::byte> bytes) {
    std::size_t done = 0;
    while (done < bytes.size()) {
      const ssize_t n =
          ::read(fd_, bytes.data() + done, std::min<std::size_t>(bytes.size() - done, std::size_t{1} << 30));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) throw DiskError(errno, path_, "cannot be read");
      if (n == 0) break;
      done += static_cast<std::size_t>(n);
    }
    return done;
  }

 private:
  const fs::path& path_;
  int fd_;
};

/// Out of the way, under a name of its own so that several can be looked at. Where the disk does not let us, the next
/// Publish replaces the file or says why it cannot.
void Quarantine(const fs::path& root, const ArtifactKey& key, const fs::path& path) {
  const std::string name = key.stage + "-" + key.digest.Hex();
  for (int i = 0; i < 1000; ++i) {
    const fs::path target =
        root / kQuarantine / (name + (i == 0 ? std::string() : std::string(".").append(std::to_string(i))) + kSuffix);
    if (::link(path.c_str(), target.c_str()) == 0) break;
    if (errno != EEXIST) {
      ::rename(path.c_str(), target.c_str());  // a file system without hard links
      return;
    }
  }
  ::unlink(path.c_str());
}

std::optional<Sha256Digest> ParseHex(const std::string& text) {
  Sha256Digest digest;
  if (text.size() != 2 * digest.bytes.size()) return std::nullopt;
  const auto digit = [](char c) { return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1; };
  for (std::size_t i = 0; i < digest.bytes.size(); ++i) {
    const int high = digit(text[2 * i]), low = digit(text[2 * i + 1]);
    if (high < 0 || low < 0) return std::nullopt;
    digest.bytes[i] = static_cast<std::uint8_t>(high * 16 + low);
  }
  return digest;
}

/// Regular files two folders below `folder`; what vanishes meanwhile is passed over.
template <class Fn>
void ForEachFile(const fs::path& folder, int depth, Fn&& fn) {
  std::error_code ignored;
  for (fs::directory_iterator it(folder, ignored), end; it != end; it.increment(ignored)) {
    if (ignored) return;
    if (depth == 0 && it->is_regular_file(ignored)) fn(it->path());
    if (depth > 0 && it->is_directory(ignored)) ForEachFile(it->path(), depth - 1, fn);
  }
}

}  // namespace

ArtifactStore::ArtifactStore(fs::path root) : root_(std::move(root)) {
  CreateFolderDurably(root_);
  CreateFolderDurably(root_ / kQuarantine);
}

ArtifactStore ArtifactStore::ForReading(fs::path root) {
  ArtifactStore store;
  store.root_ = std::move(root);
  return store;
}

ArtifactStore ArtifactStore::ForChecking(fs::path root) {
  ArtifactStore store = ForReading(std::move(root));
  store.is_for_checking_ = true;
  return store;
}

fs::path ArtifactStore::PathOf(const ArtifactKey& key) const {
  const auto is_letter = [](char c) { return (c >= 'a' && c <= 'z') || c == '-'; };
  RILIEVO_CHECK(!key.stage.empty() && std::all_of(key.stage.begin(), key.stage.end(), is_letter) &&
                key.stage != kQuarantine);
  const std::string hex = key.digest.Hex();
  return root_ / key.stage / hex.substr(0, 2) / (hex + kSuffix);
}

std::optional<std::vector<std::byte>> ArtifactStore::Read(const ArtifactKey& key) const {
  const fs::path path = PathOf(key);
  ArtifactFile file(path);
  if (!file.IsOpen()) return std::nullopt;
  if (const auto header = file.ReadHeader()) {
    std::vector<std::byte> payload(header->payload_bytes);
    if (file.ReadSome(payload) == payload.size() && Checksum(payload) == header->payload_checksum) return payload;
  }
  if (!is_for_checking_) Quarantine(root_, key, path);
  return std::nullopt;
}

bool ArtifactStore::Verify(const ArtifactKey& key) const {
  const fs::path path = PathOf(key);
  ArtifactFile file(path);
  if (!file.IsOpen()) return false;
  const auto header = file.ReadHeader();
  if (!header) return false;
  const std::unique_ptr<XXH3_state_t, decltype(&XXH3_freeState)> state(XXH3_createState(), &XXH3_freeState);
  RILIEVO_CHECK(state != nullptr && XXH3_64bits_reset(state.get()) == XXH_OK);
  std::vector<std::byte> buffer(std::size_t{1} << 20);
  std::uint64_t total_bytes = 0;
  while (const std::size_t n = file.ReadSome(buffer)) {
    XXH3_64bits_update(state.get(), buffer.data(), n);
    total_bytes += n;
  }
  return total_bytes == header->payload_bytes && XXH3_64bits_digest(state.get()) == header->payload_checksum;
}

bool ArtifactStore::Exists(const ArtifactKey& key) const {
  const fs::path path = PathOf(key);
  ArtifactFile file(path);
  return file.IsOpen() && file.ReadHeader().has_value();
}

void ArtifactStore::Publish(const ArtifactKey& key, std::span<const std::byte> payload) const {
  const fs::path path = PathOf(key);
  CreateFolderDurably(path.parent_path());
  Header header;
  header.payload_bytes = payload.size();
  header.payload_checksum = Checksum(payload);
  header.header_checksum = HeaderChecksum(header);
  WritePartsDurably(path, {std::as_bytes(std::span(&header, 1)), payload});
}

void ArtifactStore::Remove(const ArtifactKey& key) const { ::unlink(PathOf(key).c_str()); }

std::vector<ArtifactKey> ArtifactStore::List(const std::string& stage) const {
  std::vector<ArtifactKey> keys;
  ForEachFile(root_ / stage, 1, [&](const fs::path& path) {
    if (path.extension() != kSuffix) return;
    if (const auto digest = ParseHex(path.stem().string())) keys.push_back({stage, *digest});
  });
  std::sort(keys.begin(), keys.end());
  return keys;
}

std::size_t ArtifactStore::RemoveStaleTemporaries() const {
  std::size_t removed = 0;
  ForEachFile(root_, 2,
              [&](const fs::path& path) { removed += IsStaleTemporary(path) && ::unlink(path.c_str()) == 0; });
  return removed;
}

std::size_t RemoveStaleTemporariesIn(const fs::path& folder) {
  std::size_t removed = 0;
  ForEachFile(folder, 0,
              [&](const fs::path& path) { removed += IsStaleTemporary(path) && ::unlink(path.c_str()) == 0; });
  return removed;
}

void WriteFileDurably(const fs::path& path, std::span<const std::byte> content) { WritePartsDurably(path, {content}); }

}  // namespace rilievo::engine
