// Copies of a photograph are found by their bytes.
#include "block/io/duplicate_images.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "block/io/image_header.h"
#include "tests/unit/block/io/scratch_folder.h"

namespace rilievo::io {
namespace {

std::string Jpeg(int grey) {
  std::vector<unsigned char> bytes;
  cv::imencode(".jpg", cv::Mat(30, 40, CV_8UC1, cv::Scalar::all(grey)), bytes);
  return {bytes.begin(), bytes.end()};
}

TEST(QuarantineDuplicates, LaterCopiesGoAndNothingElse) {
  const ScratchFolder scratch;
  std::vector<Image> images;
  for (const auto& [name, grey] : std::vector<std::pair<std::string, int>>{
           {"a.jpg", 10}, {"b.jpg", 90}, {"backup/a.jpg", 10}, {"c.jpg", 200}, {"old/b.jpg", 90}, {"z/a.jpg", 10}}) {
    scratch.Write(name, Jpeg(grey));
    images.push_back(ReadImageHeader(scratch.path(), name));
  }
  std::vector<QuarantinedImage> quarantined{{"x.jpg", "truncated"}};
  QuarantineDuplicates(images, quarantined);
  ASSERT_EQ(images.size(), 3U);
  EXPECT_EQ(images[0].name, "a.jpg");
  EXPECT_EQ(images[1].name, "b.jpg");
  EXPECT_EQ(images[2].name, "c.jpg");
  EXPECT_EQ(images[2].content, HashFile(scratch.path() / "c.jpg"));
  ASSERT_EQ(quarantined.size(), 4U);
  EXPECT_EQ(quarantined[0].name, "x.jpg");
  EXPECT_EQ(quarantined[1].name, "backup/a.jpg");
  EXPECT_EQ(quarantined[1].reason, "same file as a.jpg");
  EXPECT_EQ(quarantined[2].reason, "same file as b.jpg");
  EXPECT_EQ(quarantined[3].name, "z/a.jpg");
  EXPECT_EQ(quarantined[3].reason, "same file as a.jpg");
  QuarantineDuplicates(images, quarantined);
  EXPECT_EQ(images.size() + quarantined.size(), 7U);
}

}  // namespace
}  // namespace rilievo::io
