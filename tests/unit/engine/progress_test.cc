// What people and programs read while a run is under way; time is the test's own.
#include "engine/progress.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <sstream>

namespace rilievo::engine {
namespace {

using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::Not;

Task MakeTask(const std::string& stage, int i, double work) {
  Task task;
  task.name = stage + " \"" + std::to_string(i) + "\" \xff";  // a quote, and a byte that is not UTF-8
  task.stage = stage;
  task.cost.work = work;
  return task;
}

class ProgressTest : public ::testing::Test {
 protected:
  ~ProgressTest() override {
    std::fclose(out_);
    std::free(text_);
  }
  std::unique_ptr<Progress> Make(ProgressStyle style) {
    return std::make_unique<Progress>(out_, style, [this] { return now_s_; });
  }
  std::string Text() {
    std::fflush(out_);
    return std::string(text_, size_);
  }
  std::vector<std::string> Lines() {
    std::vector<std::string> lines;
    std::istringstream stream(Text());
    for (std::string line; std::getline(stream, line);) lines.push_back(line);
    return lines;
  }
  void RunOne(Progress& progress, std::uint32_t id, const Task& task, double seconds_s,
              TaskOutcome outcome = {TaskState::kDone, false, 0, 0, ""}) {
    progress.OnTaskStarted(TaskId(id), task, 0);
    now_s_ += seconds_s;
    progress.OnTaskFinished(TaskId(id), task, outcome, {});
  }

  char* text_ = nullptr;
  std::size_t size_ = 0;
  std::FILE* out_ = ::open_memstream(&text_, &size_);
  double now_s_ = 100;
};

TEST_F(ProgressTest, JsonLinesCarryCountsRateTimeLeftAndFraction) {
  const auto progress = Make(ProgressStyle::kJson);
  const Task task = MakeTask("features", 0, 2);
  for (std::uint32_t i = 0; i < 4; ++i) progress->OnTaskAdded(TaskId(i), task);
  RunOne(*progress, 0, task, 10);
  const auto last = nlohmann::json::parse(Lines().at(Lines().size() - 2));
  EXPECT_EQ(last["event"], "task");
  EXPECT_EQ(last["stage"], "features");
  EXPECT_EQ(last["state"], "done");
  EXPECT_EQ(last["done"], 1);
  EXPECT_EQ(last["total"], 4);
  EXPECT_DOUBLE_EQ(last["rate_per_s"], 0.1);
  EXPECT_DOUBLE_EQ(last["eta_s"], 30);
  EXPECT_DOUBLE_EQ(last["fraction"], 0.25);
  RunOne(*progress, 1, task, 10, {TaskState::kFailed, false, 0, 0, "it \"broke\""});
  RunOne(*progress, 2, task, 0, {TaskState::kDone, true, 0, 0, ""});
  RunOne(*progress, 3, task, 10);
  progress->Finish();
  progress->Finish();
  int ends = 0;
  for (const auto& line : Lines()) {
    const auto object = nlohmann::json::parse(line);
    for (const char* key : {"event", "stage", "done", "total", "reused", "failed", "rate_per_s", "eta_s", "fraction"})
      EXPECT_TRUE(object.contains(key)) << line;
    ends += object["event"] == "end";
  }
  EXPECT_EQ(ends, 1);
  const auto end = nlohmann::json::parse(Lines().back());
  EXPECT_EQ(end["event"], "end");
  EXPECT_EQ(end["done"], 4);
  EXPECT_EQ(end["reused"], 1);
  EXPECT_EQ(end["failed"], 1);
  EXPECT_EQ(end["fraction"], 1);
}

TEST_F(ProgressTest, TimeLeftComesFromDeclaredWorkNotFromCounts) {
  const auto progress = Make(ProgressStyle::kJson);
  const Task light = MakeTask("s", 0, 1), heavy = MakeTask("s", 1, 9);
  progress->OnTaskAdded(TaskId(0), light);
  progress->OnTaskAdded(TaskId(1), heavy);
  RunOne(*progress, 0, light, 5);
  const auto last = nlohmann::json::parse(Lines().at(Lines().size() - 2));
  EXPECT_DOUBLE_EQ(last["eta_s"], 45);
  EXPECT_DOUBLE_EQ(last["fraction"], 0.1);
  // A running task's own fraction moves both.
  progress->OnTaskStarted(TaskId(1), heavy, 0);
  now_s_ += 20;
  progress->OnTaskProgress(TaskId(1), heavy, 0.5);
  const auto later = nlohmann::json::parse(Lines().back());
  EXPECT_DOUBLE_EQ(later["fraction"], 0.55);
  EXPECT_NEAR(later["eta_s"], 4.5 * 25 / 5.5, 1e-3);
}

TEST_F(ProgressTest, ReusedTasksSayNothingAboutSpeed) {
  const auto progress = Make(ProgressStyle::kJson);
  const Task task = MakeTask("s", 0, 1);
  for (std::uint32_t i = 0; i < 102; ++i) progress->OnTaskAdded(TaskId(i), task);
  for (std::uint32_t i = 0; i < 100; ++i) RunOne(*progress, i, task, 0, {TaskState::kDone, true, 0, 0, ""});
  RunOne(*progress, 100, task, 7);
  const auto last = nlohmann::json::parse(Lines().at(Lines().size() - 2));
  EXPECT_DOUBLE_EQ(last["eta_s"], 7);
  EXPECT_EQ(last["reused"], 100);
}

TEST_F(ProgressTest, PlainLinesComeSeldomAndEachStageHasALastOne) {
  const auto progress = Make(ProgressStyle::kPlain);
  const Task a = MakeTask("images", 0, 1), b = MakeTask("matching", 1, 1);
  for (std::uint32_t i = 0; i < 100; ++i) progress->OnTaskAdded(TaskId(i), i < 50 ? a : b);
  for (std::uint32_t i = 0; i < 100; ++i) RunOne(*progress, i, i < 50 ? a : b, 0.1);
  progress->Finish();
  const auto lines = Lines();
  EXPECT_GE(lines.size(), 4u);
  EXPECT_LE(lines.size(), 10u);  // 10 seconds, at most two lines every two seconds
  EXPECT_THAT(Text(), Not(HasSubstr("\x1b")));
  EXPECT_THAT(Text(), ContainsRegex("images +50/50 +100 %.*in 5.0 s"));
  EXPECT_THAT(lines.back(), ContainsRegex("matching +50/50 +100 %.*total 100 %"));
}

TEST_F(ProgressTest, TheTerminalShowsOneLineAStageAndTheTotal) {
  const auto progress = Make(ProgressStyle::kTerminal);
  const Task a = MakeTask("images", 0, 1), b = MakeTask("matching", 1, 1);
  for (std::uint32_t i = 0; i < 20; ++i) progress->OnTaskAdded(TaskId(i), i < 10 ? a : b);
  for (std::uint32_t i = 0; i < 15; ++i) RunOne(*progress, i, i < 10 ? a : b, 0.05);
  RunOne(*progress, 15, b, 0.05, {TaskState::kFailed, false, 0, 0, "no"});
  progress->Finish();
  // The screen: what the cursor movements leave of the lines.
  std::vector<std::string> screen;
  std::size_t row = 0;
  for (std::string line : Lines()) {
    if (line.starts_with("\x1b[")) {
      const auto up = line.find('A');
      row -= static_cast<std::size_t>(std::stoi(line.substr(2, up - 2)));
      line = line.substr(up + 1);
    }
    ASSERT_TRUE(line.starts_with("\r")) << line;
    screen.resize(std::max(screen.size(), row + 1));
    screen[row++] = line.substr(1, line.find('\x1b') - 1);
    EXPECT_LT(screen[row - 1].size(), 80u);
  }
  ASSERT_EQ(screen.size(), 3u);
  EXPECT_THAT(screen[0], ContainsRegex("^images +10/10 +100 %.*/s"));
  EXPECT_THAT(screen[1], ContainsRegex("^matching +6/10 +60 %.*ETA.*1 failed"));
  EXPECT_THAT(screen[2], ContainsRegex("^total +16/20 +80 %"));
}

TEST_F(ProgressTest, QuietSaysNothing) {
  {
    const auto progress = Make(ProgressStyle::kQuiet);
    const Task task = MakeTask("s", 0, 1);
    progress->OnTaskAdded(TaskId(0), task);
    RunOne(*progress, 0, task, 10);
  }
  EXPECT_EQ(Text(), "");
}

}  // namespace
}  // namespace rilievo::engine
