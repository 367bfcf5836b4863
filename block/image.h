// A photograph of the block: its file, size, EXIF data and state.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "base/hash.h"
#include "base/ids.h"

namespace rilievo {

/// The EXIF fields that orientation uses; absent fields are zero, empty or none. Pixels are always used as stored:
/// `orientation` (1..8) is recorded and never applied.
struct ExifData {
  int orientation = 1;
  double focal_mm = 0, focal_35mm_mm = 0;
  std::string make, model, serial, lens, date_time;
  std::optional<std::array<double, 3>> gnss;  ///< latitude deg, longitude deg, altitude m (WGS84)
  double focal_plane_x_res_per_mm = 0;        ///< FocalPlaneXResolution converted to pixels per mm
};

/// Which pixels of an image are used: a file of the image's size, bright (>= 128) = use, dark = ignore.
struct MaskFile {
  std::string name;                   ///< path relative to the mask folder
  Sha256Digest content;               ///< SHA-256 of the file's bytes
  std::uint64_t load_peak_bytes = 0;  ///< what decoding it holds, result included
};

struct Image {
  ImageId id;
  CameraId camera_id;
  std::string name;  ///< path relative to the image folder, '/' separated, UTF-8: unique in the block
  int width_px = 0, height_px = 0;
  int channels = 0, bits_per_sample = 8;
  /// What decoding holds beside the pixels it gives: rows, a strip, or all coefficients of a progressive JPEG.
  std::uint64_t decode_scratch_bytes = 0;
  ExifData exif;
  Sha256Digest content;          ///< SHA-256 of the file's bytes
  std::optional<MaskFile> mask;  ///< none: every pixel is used
};

/// A file that could not be used, with the reason; the rest of the block goes on without it.
struct QuarantinedImage {
  std::string name;
  std::string reason;
};

}  // namespace rilievo
