// Runs share a workspace, cleaning has it alone, and a lock ends with what held it.
#include "scheduling/workspace_lock.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "base/error.h"

namespace rilievo::scheduling {
namespace {

class Lock : public ::testing::Test {
 protected:
  Lock() { std::filesystem::create_directories(dir_); }
  ~Lock() override { std::filesystem::remove_all(dir_); }
  WorkspaceLock Share() {
    return WorkspaceLock::Share(dir_, [this] { ++waits_; });
  }
  std::filesystem::path dir_ = std::filesystem::temp_directory_path() / ("rilievo-lock-" + std::to_string(::getpid()));
  std::atomic<int> waits_ = 0;
};

TEST_F(Lock, IsSharedByRunsAndRefusedToCleaning) {
  {
    const WorkspaceLock one = Share(), another = Share();
    EXPECT_FALSE(WorkspaceLock::TryAlone(dir_));
  }
  const auto alone = WorkspaceLock::TryAlone(dir_);
  EXPECT_TRUE(alone);
  EXPECT_FALSE(WorkspaceLock::TryAlone(dir_));
  EXPECT_EQ(waits_, 0);
  EXPECT_TRUE(std::filesystem::is_empty(dir_));  // nothing is left behind
}

TEST_F(Lock, ARunWaitsUntilTheCleaningHasEnded) {
  auto alone = WorkspaceLock::TryAlone(dir_);
  ASSERT_TRUE(alone);
  std::atomic<bool> has_it = false;
  std::thread run([&] {
    const WorkspaceLock lock = Share();
    has_it = true;
  });
  while (waits_ == 0) std::this_thread::yield();
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_FALSE(has_it);
  alone.reset();
  run.join();
  EXPECT_TRUE(has_it);
  EXPECT_EQ(waits_, 1);
}

TEST_F(Lock, WithoutAFolderARunGoesOnAndCleaningSaysWhy) {
  const std::filesystem::path none = dir_ / "none";
  WorkspaceLock::Share(none, [this] { ++waits_; });
  EXPECT_EQ(waits_, 0);
  EXPECT_THROW(WorkspaceLock::TryAlone(none), Error);
}

}  // namespace
}  // namespace rilievo::scheduling
