// Memory of decoding: what a process holds at most, against LoadPeakBytes, for every way a file may be stored.
#include <gtest/gtest.h>
#include <malloc.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <tiffio.h>
#include <unistd.h>

#include <cstdio>
#include <functional>
#include <opencv2/imgcodecs.hpp>

#include <jpeglib.h>

#include "base/rng.h"
#include "block/io/image_header.h"
#include "stages/images/decode.h"
#include "tests/unit/block/io/scratch_folder.h"

namespace rilievo::images {
namespace {

constexpr int kWidth = 3000, kHeight = 2200;

/// Runs `action` in a process of its own, whose high-water mark is its own; returns by how many bytes that grew.
double GrowthOf(const std::function<void()>& action) {
  int ends[2];
  if (pipe(ends) != 0) return -1;
  const pid_t child = fork();
  if (child == 0) {
    mallopt(M_MMAP_THRESHOLD, 1 << 16);
    rusage before{}, after{};
    getrusage(RUSAGE_SELF, &before);
    action();
    getrusage(RUSAGE_SELF, &after);
    const double growth = 1024.0 * static_cast<double>(after.ru_maxrss - before.ru_maxrss);
    _exit(write(ends[1], &growth, sizeof growth) == sizeof growth ? 0 : 1);
  }
  close(ends[1]);
  double growth = -1;
  const bool is_read = read(ends[0], &growth, sizeof growth) == sizeof growth;
  close(ends[0]);
  int status = 1;
  waitpid(child, &status, 0);
  return is_read && status == 0 ? growth : -1;
}

cv::Mat Picture(int type) {
  cv::Mat picture(kHeight, kWidth, type);
  Rng rng(1);
  for (int y = 0; y < kHeight; ++y)
    for (std::size_t i = 0; i < picture.step; ++i)
      picture.ptr(y)[i] = static_cast<std::uint8_t>(i / 30 + static_cast<std::size_t>(y) / 9 + rng.Below(4));
  return picture;
}

void WriteTiff(const std::string& path, int compression, int rows_per_strip, int tile) {
  const cv::Mat picture = Picture(CV_8UC3);
  TIFF* file = TIFFOpen(path.c_str(), "w");
  TIFFSetField(file, TIFFTAG_IMAGEWIDTH, kWidth);
  TIFFSetField(file, TIFFTAG_IMAGELENGTH, kHeight);
  TIFFSetField(file, TIFFTAG_SAMPLESPERPIXEL, 3);
  TIFFSetField(file, TIFFTAG_BITSPERSAMPLE, 8);
  TIFFSetField(file, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_RGB);
  TIFFSetField(file, TIFFTAG_COMPRESSION, compression);
  TIFFSetField(file, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
  if (tile > 0) {
    TIFFSetField(file, TIFFTAG_TILEWIDTH, tile);
    TIFFSetField(file, TIFFTAG_TILELENGTH, tile);
    std::vector<std::uint8_t> pixels(static_cast<std::size_t>(3 * tile * tile), 7);
    for (int y = 0; y < kHeight; y += tile)
      for (int x = 0; x < kWidth; x += tile)
        TIFFWriteTile(file, pixels.data(), static_cast<unsigned>(x), static_cast<unsigned>(y), 0, 0);
  } else {
    TIFFSetField(file, TIFFTAG_ROWSPERSTRIP, rows_per_strip);
    for (int y = 0; y < kHeight; ++y)
      TIFFWriteScanline(file, const_cast<std::uint8_t*>(picture.ptr(y)), static_cast<unsigned>(y), 0);
  }
  TIFFClose(file);
}

/// A sequential JPEG whose components follow one another in three scans.
void WriteJpegOfScans(const std::string& path) {
  const cv::Mat picture = Picture(CV_8UC3);
  jpeg_compress_struct info{};
  jpeg_error_mgr errors{};
  info.err = jpeg_std_error(&errors);
  jpeg_create_compress(&info);
  std::FILE* file = std::fopen(path.c_str(), "wb");
  jpeg_stdio_dest(&info, file);
  info.image_width = kWidth, info.image_height = kHeight, info.input_components = 3;
  info.in_color_space = JCS_RGB;
  jpeg_set_defaults(&info);
  jpeg_scan_info scans[3] = {{1, {0}, 0, 63, 0, 0}, {1, {1}, 0, 63, 0, 0}, {1, {2}, 0, 63, 0, 0}};
  info.scan_info = scans;
  info.num_scans = 3;
  jpeg_start_compress(&info, TRUE);
  for (int y = 0; y < kHeight; ++y) {
    JSAMPROW row = const_cast<std::uint8_t*>(picture.ptr(y));
    jpeg_write_scanlines(&info, &row, 1);
  }
  jpeg_finish_compress(&info);
  jpeg_destroy_compress(&info);
  std::fclose(file);
}

struct Case {
  const char* name;
  std::function<void(const std::string&)> write;
  double scratch_mb;  ///< most that may be planned beside the pixels; 0 = whatever
};

TEST(DecodeMemory, StaysBelowWhatIsPlannedWhichIsTight) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer's own memory would be measured";
#endif
  const auto by_opencv = [](int type, std::vector<int> options = {}) {
    return [=](const std::string& path) { cv::imwrite(path, Picture(type), options); };
  };
  const auto tiff = [](int compression, int rows_per_strip, int tile) {
    return [=](const std::string& path) { WriteTiff(path, compression, rows_per_strip, tile); };
  };
  const double coefficients_mb = 2 * 1.5 * kWidth * kHeight * 1e-6;
  const std::vector<Case> cases{
      {"baseline.jpg", by_opencv(CV_8UC3), 3},
      {"progressive.jpg", by_opencv(CV_8UC3, {cv::IMWRITE_JPEG_PROGRESSIVE, 1}), coefficients_mb + 4},
      {"scans.jpg", WriteJpegOfScans, coefficients_mb + 4},
      {"grey.jpg", by_opencv(CV_8UC1), 3},
      {"color.png", by_opencv(CV_8UC3), 3},
      {"deep.png", by_opencv(CV_16UC3), 3},
      {"lzw.tif", tiff(COMPRESSION_LZW, 16, 0), 4},
      {"one-strip.tif", tiff(COMPRESSION_NONE, kHeight, 0), 4},
      {"one-deflated-strip.tif", tiff(COMPRESSION_ADOBE_DEFLATE, kHeight, 0), 0},
      {"tiles.tif", tiff(COMPRESSION_LZW, 0, 512), 5}};
  for (const Case& c : cases) {
    SCOPED_TRACE(c.name);
    const ScratchFolder scratch;
    ASSERT_GE(GrowthOf([&] { c.write((scratch.path() / c.name).string()); }), 0);
    Image header;
    ASSERT_GE(GrowthOf([&] { io::ReadImageHeader(scratch.path(), c.name); }), 0);
    header = io::ReadImageHeader(scratch.path(), c.name);
    const FolderPixelSource source(scratch.path());
    for (const bool with_color : {false, true}) {
      const double growth = GrowthOf([&] { source.Load(c.name, with_color); });
      const auto planned = static_cast<double>(source.LoadPeakBytes(header, with_color));
      const double sample_bytes = (header.bits_per_sample / 8 + (with_color ? 3 : 0)) * 1.0 * kWidth * kHeight;
      ASSERT_GT(growth, 0.9 * sample_bytes);
      EXPECT_LE(growth, planned);
      EXPECT_LE(planned, 1.1 * growth + 5e6) << "more is planned than needed";
      if (c.scratch_mb > 0) {
        EXPECT_LE(planned - sample_bytes, c.scratch_mb * 1e6);
      }
    }
  }
}

}  // namespace
}  // namespace rilievo::images
