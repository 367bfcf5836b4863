// One parser a calibration format, and what they share. `path` serves messages only.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "block/io/calibration.h"

namespace rilievo::io {

std::vector<CalibrationEntry> ParseMatrixText(const std::string& path, std::string_view content);
std::vector<CalibrationEntry> ParseToml(const std::string& path, const std::string& content);
std::vector<CalibrationEntry> ParseOpenCv(const std::string& path, const std::string& content);
/// In the file's pixel frame, as ParseMatrixText and ParseOpenCv: ReadCalibration shifts the origin.
std::vector<CalibrationEntry> ParseColmapCameras(const std::string& path, std::string_view content);

/// Error about a calibration file, with the list of formats; `line` 0 = none.
Error BadCalibration(const std::string& path, std::size_t line, const std::string& message);
Error UnsupportedCalibration(const std::string& path, std::size_t line, const std::string& message);

/// Throws unless all numbers are finite, focal lengths positive and sizes plausible.
void CheckEntry(const std::string& path, std::size_t line, const CalibrationEntry& entry);

/// The parameters' smallest kind of PINHOLE, OPENCV and FULL_OPENCV.
CameraModelKind SmallestKind(const CameraModel& model);

}  // namespace rilievo::io
