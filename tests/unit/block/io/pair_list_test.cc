// Pair lists: every way to write two names, and a line for every mistake.
#include "block/io/pair_list.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/block/io/scratch_folder.h"

namespace rilievo::io {
namespace {

using testing::HasSubstr;

class PairListFile : public testing::Test {
 protected:
  PairListFile() {
    for (const char* name : {"a.jpg", "b c.jpg", "left/d.jpg", "left/e.jpg", "right/e.jpg"}) {
      Image image;
      image.id = ImageId(static_cast<std::uint32_t>(block_.images.size()));
      image.name = name;
      block_.images.push_back(image);
    }
    block_.quarantined.push_back({"broken.jpg", "empty"});
  }
  PairList Read(const std::string& content) { return ReadPairList(scratch_.Write("pairs.txt", content), block_); }
  static ImagePair Pair(std::uint32_t a, std::uint32_t b) { return {ImageId(a), ImageId(b)}; }

  ScratchFolder scratch_;
  Block block_;
};

TEST_F(PairListFile, NamesMayHaveBlanksInQuotesOrBetweenTabs) {
  const auto list = Read(
      "\xEF\xBB\xBF# pairs\r\n\r\na.jpg \"b c.jpg\"\r\nb c.jpg\tleft/d.jpg\n  left/e.jpg   right/e.jpg  "
      "\n\"a.jpg\"\td.jpg\n");
  EXPECT_EQ(list.pairs, (std::vector{Pair(0, 1), Pair(0, 2), Pair(1, 2), Pair(3, 4)}));
  EXPECT_EQ(list.left_out, 0U);
}

TEST_F(PairListFile, APairInEitherOrderCountsOnce) {
  EXPECT_EQ(Read("d.jpg a.jpg\na.jpg left/d.jpg\na.jpg d.jpg\n").pairs, (std::vector{Pair(0, 2)}));
}

TEST_F(PairListFile, ImagesThatCannotBeUsedAreCountedAndLeftOut) {
  const auto list = Read("a.jpg broken.jpg\nbroken.jpg d.jpg\na.jpg d.jpg\n");
  EXPECT_EQ(list.pairs, (std::vector{Pair(0, 2)}));
  EXPECT_EQ(list.left_out, 2U);
}

TEST_F(PairListFile, NamesItsMistakes) {
  EXPECT_THAT(ErrorOf([&] { Read("a.jpg d.jpg\n\na.jpg z.jpg\n"); }),
              HasSubstr("pairs.txt: line 3: 'z.jpg' is none of the images"));
  EXPECT_THAT(ErrorOf([&] { Read("a.jpg b c.jpg\n"); }), HasSubstr("line 1: holds 3 names"));
  EXPECT_THAT(ErrorOf([&] { Read("a.jpg\n"); }), HasSubstr("line 1: holds 1 names"));
  EXPECT_THAT(ErrorOf([&] { Read("a.jpg\tb c.jpg\tleft/d.jpg\n"); }), HasSubstr("line 1: holds 3 names"));
  EXPECT_THAT(ErrorOf([&] { Read("a.jpg \"b c.jpg\n"); }), HasSubstr("line 1: a double quote is not closed"));
  EXPECT_THAT(ErrorOf([&] { Read("a.jpg e.jpg\n"); }), HasSubstr("may be left/e.jpg or right/e.jpg"));
  EXPECT_THAT(ErrorOf([&] { Read("left/d.jpg d.jpg\n"); }), HasSubstr("'left/d.jpg' is paired with itself"));
  EXPECT_THAT(ErrorOf([&] { Read("# nothing\na.jpg broken.jpg\n"); }), HasSubstr("names no pair of usable images"));
  EXPECT_THAT(ErrorOf([&] { ReadPairList(scratch_.path() / "none.txt", block_); }), HasSubstr("cannot be opened"));
}

}  // namespace
}  // namespace rilievo::io
