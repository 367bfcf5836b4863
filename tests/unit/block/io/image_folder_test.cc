// Finding images, natural order, order files and their mistakes.
#include "block/io/image_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "base/rng.h"
#include "tests/unit/block/io/scratch_folder.h"

namespace rilievo::io {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

TEST(NaturalLess, NumbersCompareAsNumbers) {
  EXPECT_TRUE(NaturalLess("IMG_2.jpg", "IMG_10.jpg"));
  EXPECT_FALSE(NaturalLess("IMG_10.jpg", "IMG_2.jpg"));
  EXPECT_TRUE(NaturalLess("a9b2", "a9b10"));
  EXPECT_TRUE(NaturalLess("IMG_99999999999999999999998", "IMG_99999999999999999999999"));  // beyond 64 bits
  EXPECT_TRUE(NaturalLess("a", "a1"));
  EXPECT_NE(NaturalLess("a01", "a1"), NaturalLess("a1", "a01"));
}

TEST(NaturalLess, IsATotalOrder) {
  Rng rng(3);
  std::vector<std::string> names;
  for (int i = 0; i < 70; ++i) {
    std::string name;
    for (std::uint32_t k = rng.Below(6); k > 0; --k) name += "01a/-9\xC3"[rng.Below(7)];
    names.push_back(name);
  }
  for (const auto& a : names)
    for (const auto& b : names) {
      EXPECT_EQ(NaturalLess(a, b) + NaturalLess(b, a) + (a == b), 1) << a << " | " << b;
      for (const auto& c : names) {
        EXPECT_TRUE(!NaturalLess(a, b) || !NaturalLess(b, c) || NaturalLess(a, c)) << a << " | " << b << " | " << c;
      }
    }
}

TEST(FindImages, TakesImagesOfAllSubfoldersInNaturalOrder) {
  const ScratchFolder scratch;
  const auto folder = scratch.path() /
                      "Fotos \xC3\xBC"
                      "ber Z\xC3\xBCrich";
  for (const char* name : {"IMG_10.JPG", "IMG_2.jpg", "sub folder/b.TiFF", "sub folder/a.png", "x.tif", "y.jpeg",
                           "K.txt", "0000.jpg.camera", ".hidden.jpg", ".cache/z.jpg", "readme", "project.xml"})
    scratch.Write(folder / name, "x");
  std::filesystem::create_directory(folder / "folder.jpg");
  std::filesystem::create_symlink(folder / "IMG_2.jpg", folder / "link.jpg");
  const FoundImages found = FindImages(folder);
  EXPECT_THAT(found.names, ElementsAre("IMG_2.jpg", "IMG_10.JPG", "link.jpg", "sub folder/a.png", "sub folder/b.TiFF",
                                       "x.tif", "y.jpeg"));
  EXPECT_TRUE(found.ignored.empty());
}

TEST(FindImages, ReportsPhotographsItCannotUse) {
  const ScratchFolder scratch;
  scratch.Write("a.jpg", "x");
  scratch.Write("raw.CR2", "x");
  scratch.Write("latin\xFC.jpg", "x");
  std::filesystem::create_symlink("nowhere.jpg", scratch.path() / "broken.jpg");
  const FoundImages found = FindImages(scratch.path());
  EXPECT_THAT(found.names, ElementsAre("a.jpg"));
  ASSERT_EQ(found.ignored.size(), 3U);
  EXPECT_THAT(found.ignored[0].reason, HasSubstr("does not exist"));
  EXPECT_EQ(found.ignored[1].name, "latin\\xfc.jpg");
  EXPECT_THAT(found.ignored[2].reason, HasSubstr("cr2 is not read"));
}

TEST(FindImages, NamesWithControlCharactersAreReportedEscaped) {
  const ScratchFolder scratch;
  for (const char* name : {"a.jpg", "b\n1.jpg", "esc\x1B[2J/c.jpg", "\xC3\xA9\x7F.png", "line\nend.cr2"})
    scratch.Write(name, "x");
  const FoundImages found = FindImages(scratch.path());
  EXPECT_THAT(found.names, ElementsAre("a.jpg"));
  std::vector<std::string> names;
  for (const auto& ignored : found.ignored) names.push_back(ignored.name);
  EXPECT_THAT(names, ElementsAre("b\\x0a1.jpg", "esc\\x1b[2J/c.jpg", "line\\x0aend.cr2", "\xC3\xA9\\x7f.png"));
  EXPECT_THAT(found.ignored.front().reason, HasSubstr("control characters"));
}

TEST(FindImages, LinkedFoldersAreReportedNotFollowed) {
  const ScratchFolder scratch;
  scratch.Write("in/a.jpg", "x");
  std::filesystem::create_directory_symlink(scratch.path(), scratch.path() / "in/circle");
  std::filesystem::create_directory_symlink(scratch.path() / "in", scratch.path() / ".hidden");
  const FoundImages found = FindImages(scratch.path());
  EXPECT_THAT(found.names, ElementsAre("in/a.jpg"));
  ASSERT_EQ(found.ignored.size(), 1U);
  EXPECT_EQ(found.ignored[0].name, "in/circle");
  EXPECT_THAT(found.ignored[0].reason, HasSubstr("not followed"));
  const auto root = scratch.path() / "in/circle";  // the image folder itself may be a link
  EXPECT_THAT(FindImages(root).names, ElementsAre("in/a.jpg"));
}

/// A user for whom permissions count, while it lives: root reads everything.
class OrdinaryUser {
 public:
  OrdinaryUser() { works_ = ::geteuid() != 0 || ::seteuid(65534) == 0; }
  OrdinaryUser(const OrdinaryUser&) = delete;
  OrdinaryUser& operator=(const OrdinaryUser&) = delete;
  ~OrdinaryUser() {
    if (::getuid() == 0) {
      EXPECT_EQ(::seteuid(0), 0);
    }
  }
  bool works() const { return works_; }

 private:
  bool works_ = false;
};

TEST(FindImages, AFolderThatCannotBeReadEndsNothing) {
  namespace fs = std::filesystem;
  const ScratchFolder scratch;
  for (const char* name : {"a.jpg", "lost+found/b.jpg", "z/c.jpg"}) scratch.Write(name, "x");
  fs::permissions(scratch.path(), fs::perms::all);
  fs::permissions(scratch.path() / "lost+found", fs::perms::none);
  {
    const OrdinaryUser user;
    if (!user.works()) GTEST_SKIP() << "cannot become another user";
    const FoundImages found = FindImages(scratch.path());
    EXPECT_THAT(found.names, ElementsAre("a.jpg", "z/c.jpg"));
    ASSERT_EQ(found.ignored.size(), 1U);
    EXPECT_EQ(found.ignored[0].name, "lost+found");
    EXPECT_THAT(found.ignored[0].reason, HasSubstr("folder cannot be read: Permission denied"));
    EXPECT_THAT(ErrorOf([&] { FindImages(scratch.path() / "lost+found"); }), HasSubstr("cannot be read"));
  }
  fs::permissions(scratch.path() / "lost+found", fs::perms::owner_all);
}

TEST(FindImages, SaysWhatIsWrongWithTheFolder) {
  const ScratchFolder scratch;
  EXPECT_THAT(ErrorOf([&] { FindImages(scratch.path() / "none"); }), HasSubstr("does not exist"));
  EXPECT_THAT(ErrorOf([&] { FindImages(scratch.Write("a.jpg", "x")); }), HasSubstr("is not a folder"));
  std::filesystem::create_directory(scratch.path() / "empty");
  EXPECT_THAT(ErrorOf([&] { FindImages(scratch.path() / "empty"); }), HasSubstr("no image found"));
  EXPECT_THAT(ErrorOf([&] { FindImages(""); }), HasSubstr("does not exist"));
}

class OrderFile : public testing::Test {
 protected:
  std::vector<std::string> Read(const std::string& content) {
    return ReadOrderFile(scratch_.Write("order.txt", content), names_);
  }
  ScratchFolder scratch_;
  std::vector<std::string> names_{"a.jpg", "b c.jpg", "left/d.jpg", "left/e.jpg", "right/e.jpg"};
};

TEST_F(OrderFile, GivesTheImagesInItsOrder) {
  const auto order = Read("\xEF\xBB\xBF# ring\r\n\r\nleft/e.jpg\r\n  b c.jpg  \r\nd.jpg");
  EXPECT_THAT(order, ElementsAre("left/e.jpg", "b c.jpg", "left/d.jpg"));
  const auto left_out = LeftOutByOrder(names_, order);
  ASSERT_EQ(left_out.size(), 2U);
  EXPECT_EQ(left_out[0].name, "a.jpg");
  EXPECT_EQ(left_out[1].name, "right/e.jpg");
}

TEST_F(OrderFile, MayStartWithACount) { EXPECT_THAT(Read("2\nb c.jpg\na.jpg\n"), ElementsAre("b c.jpg", "a.jpg")); }

TEST_F(OrderFile, NamesItsMistakes) {
  EXPECT_THAT(ErrorOf([&] { Read("a.jpg\nz.jpg\n"); }), HasSubstr("order.txt: line 2: 'z.jpg' is none of the images"));
  EXPECT_THAT(ErrorOf([&] { Read("a.jpg\n2\n"); }), HasSubstr("line 2: '2'"));
  EXPECT_THAT(ErrorOf([&] { Read("a.jpg\n#\nb c.jpg\na.jpg\n"); }), HasSubstr("line 4: 'a.jpg' was already on line 1"));
  EXPECT_THAT(ErrorOf([&] { Read("left/d.jpg\nd.jpg\n"); }), HasSubstr("already on line 1"));
  EXPECT_THAT(ErrorOf([&] { Read("e.jpg\n"); }), HasSubstr("may be left/e.jpg or right/e.jpg"));
  EXPECT_THAT(ErrorOf([&] { Read("\n# nothing\n"); }), HasSubstr("names no image"));
  EXPECT_THAT(ErrorOf([&] { ReadOrderFile(scratch_.path() / "none.txt", names_); }), HasSubstr("cannot be opened"));
  EXPECT_THAT(ErrorOf([&] { ReadOrderFile(scratch_.path(), names_); }), HasSubstr("is a folder"));
}

TEST(OrderFileOfRealData, Temple47) {
  if (DataFolder().empty()) GTEST_SKIP() << "RILIEVO_DATA is not set";
  const auto folder = DataFolder() / "temple47";
  const FoundImages found = FindImages(folder);
  EXPECT_EQ(found.names.size(), 47U);
  const auto order = ReadOrderFile(folder / "ordered_filenames.txt", found.names);
  EXPECT_EQ(order.size() + LeftOutByOrder(found.names, order).size(), 47U);
  EXPECT_EQ(order.front(), "templeR0041.png");
}

}  // namespace
}  // namespace rilievo::io
