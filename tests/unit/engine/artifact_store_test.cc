// Artifacts survive the round trip, and nothing damaged, half written or forbidden is taken for one.
#include "engine/artifact_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <thread>

#include "base/error.h"
#include "base/rng.h"
#include "engine/artifact_key.h"

namespace rilievo::engine {
namespace {

namespace fs = std::filesystem;

std::vector<std::byte> RandomBytes(std::size_t size, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<std::byte> bytes(size);
  for (auto& b : bytes) b = static_cast<std::byte>(rng.Next());
  return bytes;
}

std::vector<std::byte> ReadFile(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::string text((std::istreambuf_iterator<char>(file)), {});
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

void WriteFile(const fs::path& path, std::span<const std::byte> bytes) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

ArtifactKey Key(std::uint64_t number) { return ArtifactKeyBuilder("test-stage", 1).AddNumber(number).Finish(); }

std::size_t CountFiles(const fs::path& folder) {
  std::size_t count = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) count += entry.is_regular_file();
  return count;
}

class ArtifactStoreTest : public ::testing::Test {
 protected:
  ArtifactStoreTest() {
    std::string pattern = (fs::temp_directory_path() / "rilievo-store-XXXXXX").string();
    root_ = ::mkdtemp(pattern.data());
  }
  ~ArtifactStoreTest() override {
    std::error_code ignored;
    fs::permissions(root_, fs::perms::owner_all, ignored);
    fs::remove_all(root_, ignored);
  }
  fs::path root_;
};

TEST_F(ArtifactStoreTest, RoundTripOfManySizes) {
  const ArtifactStore store(root_ / "store with spaces and ünïcode");
  for (const std::size_t size : {0, 1, 39, 40, 41, 4096, 1 << 20, (1 << 20) + 1, 3000000}) {
    const auto payload = RandomBytes(size, size);
    EXPECT_FALSE(store.Exists(Key(size)));
    EXPECT_FALSE(store.Verify(Key(size)));
    EXPECT_EQ(store.Read(Key(size)), std::nullopt);
    store.Publish(Key(size), payload);
    EXPECT_TRUE(store.Exists(Key(size)));
    EXPECT_TRUE(store.Verify(Key(size)));
    EXPECT_EQ(store.Read(Key(size)), payload);
  }
}

TEST_F(ArtifactStoreTest, PublishingAgainIsHarmlessAndLeavesNoTemporaries) {
  const ArtifactStore store(root_);
  const auto payload = RandomBytes(1000, 1);
  for (int i = 0; i < 3; ++i) store.Publish(Key(1), payload);
  EXPECT_EQ(store.Read(Key(1)), payload);
  EXPECT_EQ(CountFiles(root_), 1u);
}

TEST_F(ArtifactStoreTest, EveryDamagedByteIsSeenAndQuarantined) {
  const ArtifactStore store(root_);
  const auto payload = RandomBytes(50, 7);
  store.Publish(Key(1), payload);
  const auto good = ReadFile(store.PathOf(Key(1)));
  ASSERT_EQ(good.size(), 90u);
  std::size_t quarantined = 0;
  for (std::size_t i = 0; i < good.size(); ++i) {
    for (const int flip : {0x01, 0x80, 0xff}) {
      auto bad = good;
      bad[i] ^= static_cast<std::byte>(flip);
      WriteFile(store.PathOf(Key(1)), bad);
      ASSERT_FALSE(store.Verify(Key(1))) << "byte " << i;
      ASSERT_EQ(store.Read(Key(1)), std::nullopt) << "byte " << i;
      ASSERT_FALSE(fs::exists(store.PathOf(Key(1))));
      ASSERT_EQ(CountFiles(root_ / "quarantine"), ++quarantined);
    }
  }
  store.Publish(Key(1), payload);
  EXPECT_EQ(store.Read(Key(1)), payload);
}

TEST_F(ArtifactStoreTest, EveryTruncationAndAnyTailIsSeen) {
  const ArtifactStore store(root_);
  store.Publish(Key(1), RandomBytes(50, 7));
  const auto good = ReadFile(store.PathOf(Key(1)));
  for (std::size_t size = 0; size < good.size(); ++size) {
    WriteFile(store.PathOf(Key(1)), std::span(good).first(size));
    ASSERT_FALSE(store.Exists(Key(1))) << size << " bytes";
    ASSERT_EQ(store.Read(Key(1)), std::nullopt) << size << " bytes";
  }
  auto longer = good;
  longer.push_back(std::byte{0});
  WriteFile(store.PathOf(Key(1)), longer);
  EXPECT_FALSE(store.Exists(Key(1)));
  EXPECT_EQ(store.Read(Key(1)), std::nullopt);
}

TEST_F(ArtifactStoreTest, AnotherFormatVersionSaysWhatToDo) {
  const ArtifactStore store(root_);
  store.Publish(Key(1), RandomBytes(50, 7));
  auto file = ReadFile(store.PathOf(Key(1)));
  file[8] = std::byte{2};
  const std::uint64_t checksum = Checksum(std::span(file).first(32));
  std::memcpy(file.data() + 32, &checksum, sizeof checksum);
  WriteFile(store.PathOf(Key(1)), file);
  try {
    store.Read(Key(1));
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kVersion);
    EXPECT_THAT(error.what(), ::testing::HasSubstr("new workspace"));
  }
  EXPECT_TRUE(fs::exists(store.PathOf(Key(1))));
}

TEST_F(ArtifactStoreTest, TwoWritersOfOneKeyNeverShowAHalfFile) {
  const auto payload = RandomBytes(200000, 3);
  std::vector<std::thread> writers;
  for (int w = 0; w < 2; ++w) {
    writers.emplace_back([&] {
      const ArtifactStore own(root_);  // as two programs would
      for (int i = 0; i < 20; ++i) own.Publish(Key(1), payload);
    });
  }
  const ArtifactStore store(root_);
  for (int i = 0; i < 200; ++i) {
    const auto read = store.Read(Key(1));
    EXPECT_TRUE(!read || *read == payload);
  }
  for (auto& writer : writers) writer.join();
  EXPECT_EQ(store.Read(Key(1)), payload);
  EXPECT_EQ(CountFiles(root_), 1u);
}

TEST_F(ArtifactStoreTest, ReadOnlyFolderIsOneClearLine) {
  if (::geteuid() == 0) {  // permissions do not stop root; a file where a folder should be does
    WriteFile(root_ / "taken", {});
    EXPECT_THROW(ArtifactStore(root_ / "taken" / "store"), Error);
    return;
  }
  const ArtifactStore store(root_);
  fs::permissions(root_, fs::perms::owner_read | fs::perms::owner_exec);
  try {
    store.Publish(Key(1), RandomBytes(10, 1));
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kIo);
    EXPECT_THAT(error.hint(), ::testing::HasSubstr("permissions"));
  }
}

TEST_F(ArtifactStoreTest, FullDiskIsOneClearLineAndLeavesNothing) {
  const ArtifactStore store(root_);
  store.Publish(Key(1), RandomBytes(10, 1));
  // The limit holds for the whole process, so a child has it.
  const pid_t child = ::fork();
  if (child == 0) {
    ::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{100000, 100000};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    try {
      store.Publish(Key(2), RandomBytes(200000, 1));
    } catch (const Error& error) {
      const bool clear = error.code() == ErrorCode::kDiskFull && !error.path().empty() && !error.hint().empty();
      ::_exit(clear ? 42 : 43);
    }
    ::_exit(44);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(WEXITSTATUS(status), 42);
  EXPECT_FALSE(store.Exists(Key(2)));
  EXPECT_TRUE(store.Exists(Key(1)));
  EXPECT_EQ(CountFiles(root_), 1u);
}

TEST_F(ArtifactStoreTest, RemoveTakesOneArtifactAway) {
  const ArtifactStore store(root_);
  const auto payload = RandomBytes(100, 1);
  store.Publish(Key(1), payload);
  store.Publish(Key(2), payload);
  store.Remove(Key(1));
  store.Remove(Key(3));  // was never there
  EXPECT_FALSE(store.Exists(Key(1)));
  EXPECT_TRUE(store.Verify(Key(2)));
  EXPECT_THAT(store.List("test-stage"), ::testing::ElementsAre(Key(2)));
}

TEST_F(ArtifactStoreTest, ListGivesTheKeysInOrder) {
  const ArtifactStore store(root_);
  std::vector<ArtifactKey> keys;
  for (std::uint64_t i = 0; i < 50; ++i) {
    keys.push_back(Key(i));
    store.Publish(keys.back(), RandomBytes(3, i));
  }
  std::sort(keys.begin(), keys.end());
  WriteFile(store.PathOf(keys[0]).parent_path() / "stranger.art", {});
  EXPECT_EQ(store.List("test-stage"), keys);
  EXPECT_TRUE(store.List("other").empty());
}

TEST_F(ArtifactStoreTest, TemporariesOfTheDeadGoThoseOfTheLivingStay) {
  const ArtifactStore store(root_);
  store.Publish(Key(1), RandomBytes(3, 1));
  const fs::path folder = store.PathOf(Key(1)).parent_path();
  // A child is killed in the middle of a large write; the file it leaves tells how temporaries are named.
  const pid_t child = ::fork();
  if (child == 0) {
    const auto payload = RandomBytes(1000, 2);
    while (true) store.Publish(Key(1), payload);
  }
  fs::path left;
  for (int i = 0; i < 20000 && left.empty(); ++i) {
    ::kill(child, SIGSTOP);
    int status = 0;
    ::waitpid(child, &status, WUNTRACED);
    for (const auto& entry : fs::directory_iterator(folder))
      if (entry.path().extension() != ".art") left = entry.path();
    if (left.empty()) ::kill(child, SIGCONT);
  }
  ASSERT_FALSE(left.empty());
  EXPECT_EQ(store.RemoveStaleTemporaries(), 0u);
  EXPECT_TRUE(store.Exists(Key(1)));
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  EXPECT_TRUE(fs::exists(left));
  EXPECT_EQ(store.RemoveStaleTemporaries(), 1u);
  EXPECT_FALSE(fs::exists(left));

  // Somebody else's machine: only its age tells.
  const std::string name = left.filename().string();
  const auto mark = name.rfind(".tmp-") + 5;
  const fs::path foreign = folder / (name.substr(0, mark) + (name[mark] == '0' ? "1" : "0") + name.substr(mark + 1));
  WriteFile(foreign, {});
  EXPECT_EQ(store.RemoveStaleTemporaries(), 0u);
  fs::last_write_time(foreign, fs::file_time_type::clock::now() - std::chrono::hours(25));
  EXPECT_EQ(store.RemoveStaleTemporaries(), 1u);
  EXPECT_TRUE(store.Exists(Key(1)));
}

TEST_F(ArtifactStoreTest, WriteFileDurablyReplacesTheWholeFile) {
  const auto first = RandomBytes(5000, 1), second = RandomBytes(10, 2);
  WriteFileDurably(root_ / "result.json", first);
  WriteFileDurably(root_ / "result.json", second);
  EXPECT_EQ(ReadFile(root_ / "result.json"), second);
  EXPECT_EQ(CountFiles(root_), 1u);
  EXPECT_THROW(WriteFileDurably(root_ / "absent" / "result.json", second), Error);
}

TEST(ArtifactKeyTest, EveryEntryAndItsPlaceCounts) {
  const Sha256Digest a = KeyHasher().Add(std::uint64_t{1}).Finish(), b = KeyHasher().Add(std::uint64_t{2}).Finish();
  const auto build = [](const char* stage, std::uint64_t version) { return ArtifactKeyBuilder(stage, version); };
  std::vector<ArtifactKey> keys{
      build("s", 1).Finish(),
      build("t", 1).Finish(),
      build("s", 2).Finish(),
      build("s", 1).AddOptions("x=1\n").Finish(),
      build("s", 1).AddText("x=1\n").Finish(),
      build("s", 1).AddOptions("x=2\n").Finish(),
      build("s", 1).AddInput(a).AddInput(b).Finish(),
      build("s", 1).AddInput(b).AddInput(a).Finish(),
      build("s", 1).AddInput(a).Finish(),
      build("s", 1).AddNumber(1).Finish(),
  };
  EXPECT_EQ(build("s", 1).AddInput(a).AddInput(b).Finish(), keys[6]);
  std::sort(keys.begin(), keys.end(), [](const auto& x, const auto& y) { return x.digest < y.digest; });
  for (std::size_t i = 1; i < keys.size(); ++i) EXPECT_NE(keys[i - 1].digest, keys[i].digest);
}

}  // namespace
}  // namespace rilievo::engine
