// The focal length in pixels as far as EXIF tells it.
#include "block/io/exif_focal.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string_view>

namespace rilievo::io {
namespace {

/// Width of the sensor's longer side by EXIF model name: makers' data sheets of cameras that surveyors use and whose
/// files often lack the 35 mm equivalent.
struct Sensor {
  std::string_view model;
  double width_mm;
};
constexpr std::array<Sensor, 26> kSensors{{{"Canon EOS 5D", 35.8},
                                           {"Canon EOS 5D Mark II", 36.0},
                                           {"Canon EOS 5D Mark III", 36.0},
                                           {"Canon EOS 5D Mark IV", 36.0},
                                           {"Canon EOS 5DS R", 36.0},
                                           {"Canon EOS 6D", 35.8},
                                           {"Canon EOS 6D Mark II", 35.9},
                                           {"Canon EOS R", 36.0},
                                           {"Canon EOS R5", 36.0},
                                           {"Canon EOS R6", 35.9},
                                           {"Canon EOS D60", 22.7},
                                           {"Canon EOS 10D", 22.7},
                                           {"Canon EOS 20D", 22.5},
                                           {"Canon EOS 60D", 22.3},
                                           {"Canon EOS 350D DIGITAL", 22.2},
                                           {"Canon EOS 450D", 22.2},
                                           {"Canon EOS 600D", 22.3},
                                           {"NIKON D100", 23.7},
                                           {"NIKON D200", 23.6},
                                           {"NIKON D3", 36.0},
                                           {"NIKON D700", 36.0},
                                           {"NIKON D800", 35.9},
                                           {"NIKON D810", 35.9},
                                           {"NIKON D850", 35.9},
                                           {"ILCE-7RM3", 35.9},
                                           {"FC6310", 13.2}}};

constexpr double kFilmDiagonal_mm = 43.2666;  // of 36 mm x 24 mm

std::string Text(const char* format, double a, double b) {
  char text[96];
  std::snprintf(text, sizeof text, format, a, b);
  return text;
}

/// Focal lengths from fisheye to long telephoto lenses; others come from broken EXIF.
bool IsPlausible(double focal_px, double longer_px) { return focal_px > 0.2 * longer_px && focal_px < 50 * longer_px; }

}  // namespace

std::optional<ExifFocal> FocalFromExif(const ExifData& exif, int width_px, int height_px) {
  const double longer_px = std::max(width_px, height_px), diagonal_px = std::hypot(width_px, height_px);
  const double from_35mm = exif.focal_35mm_mm * diagonal_px / kFilmDiagonal_mm;
  const bool has_35mm = IsPlausible(from_35mm, longer_px);
  if (exif.focal_mm > 0 && exif.focal_plane_x_res_per_mm > 0) {
    const double focal_px = exif.focal_mm * exif.focal_plane_x_res_per_mm,
                 sensor_mm = longer_px / exif.focal_plane_x_res_per_mm;
    // The 35 mm equivalent is rounded to whole millimetres and to the aspect of film: 15 % apart means a resized image.
    const bool agrees = !has_35mm || std::abs(focal_px / from_35mm - 1) < 0.15;
    if (agrees && IsPlausible(focal_px, longer_px) && sensor_mm > 3 && sensor_mm < 60)
      return ExifFocal{focal_px,
                       Text("%g mm, sensor %.1f mm wide by its focal plane resolution", exif.focal_mm, sensor_mm)};
  }
  for (const Sensor& sensor : kSensors) {
    const double focal_px = exif.focal_mm / sensor.width_mm * longer_px;
    if (exif.model == sensor.model && IsPlausible(focal_px, longer_px))
      return ExifFocal{focal_px,
                       Text("%g mm, sensor %.1f mm wide by the camera's model", exif.focal_mm, sensor.width_mm)};
  }
  if (has_35mm)
    return ExifFocal{from_35mm, Text("%g mm on 35 mm film (lens %g mm)", exif.focal_35mm_mm, exif.focal_mm)};
  return std::nullopt;
}

}  // namespace rilievo::io
