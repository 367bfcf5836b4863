// Artifacts on disk: named by content key, published atomically, verified on read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/hash.h"

namespace rilievo::engine {

struct ArtifactKey {
  std::string stage;  ///< folder name, [a-z-]+
  Sha256Digest digest;
  friend auto operator<=>(const ArtifactKey&, const ArtifactKey&) = default;
};

/// Layout: root/<stage>/<first two hex digits>/<64 hex digits>.art ; damaged files move to root/quarantine/. The file
/// format is docs/formats/artifact.md. All functions may be called from several threads and programs at once.
class ArtifactStore {
 public:
  /// Creates the folders; throws Error(kIo) with a hint when it cannot (read-only disk, missing permission).
  explicit ArtifactStore(std::filesystem::path root);
  /// A store that is only read: creates nothing, and `root` need not exist (then nothing is found).
  static ArtifactStore ForReading(std::filesystem::path root);
  /// The same, and what is damaged stays where it is.
  static ArtifactStore ForChecking(std::filesystem::path root);

  /// The payload, or none when absent or damaged (a damaged file is quarantined first, unless the store is for
  /// checking). Throws Error(kVersion) for an intact file of another format version and Error(kIo) when the disk cannot
  /// be read.
  std::optional<std::vector<std::byte>> Read(const ArtifactKey& key) const;
  /// True when the artifact is there and its header and checksum hold; memory O(1 MiB).
  bool Verify(const ArtifactKey& key) const;
  /// True when a file of that name and the header's length is there: cheap, for `info` and `plan`.
  bool Exists(const ArtifactKey& key) const;
  /// Temporary file, fsync, rename, fsync folder. Throws Error(kDiskFull / kIo). Publishing an existing key is
  /// harmless.
  void Publish(const ArtifactKey& key, std::span<const std::byte> payload) const;

  /// Removes the artifact, if it is there and may be removed; says nothing otherwise: it is no loss.
  void Remove(const ArtifactKey& key) const;

  /// Keys of a stage that have a file, ascending; the files are not opened.
  std::vector<ArtifactKey> List(const std::string& stage) const;
  /// Removes temporary files that a killed program left behind: those of a process of this machine that no longer
  /// lives, and any older than a day. For program start; they harm nothing but take space. Returns how many.
  std::size_t RemoveStaleTemporaries() const;

  std::filesystem::path PathOf(const ArtifactKey& key) const;
  const std::filesystem::path& root() const { return root_; }

 private:
  ArtifactStore() = default;
  std::filesystem::path root_;
  bool is_for_checking_ = false;
};

/// The same removal in one folder, not below it. Returns how many.
std::size_t RemoveStaleTemporariesIn(const std::filesystem::path& folder);

/// The same durable write for a plain file (results, exports, JSON): temporary name beside it, fsync, rename, fsync
/// folder.
void WriteFileDurably(const std::filesystem::path& path, std::span<const std::byte> content);

}  // namespace rilievo::engine
