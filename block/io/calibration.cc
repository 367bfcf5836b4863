// Tells the format of a calibration file by its content; checks and pixel origins that all formats share.
#include "block/io/calibration.h"

#include <algorithm>
#include <cctype>
#include <cmath>

#include "block/io/calibration_formats.h"
#include "block/io/camera_params.h"
#include "block/io/text.h"

namespace rilievo::io {
namespace {

constexpr char kFormatsHint[] =
    "a calibration is a 3x3 K matrix as text, a rilievo TOML, an OpenCV YAML or XML, or a COLMAP cameras.txt";

enum class Format { kMatrixText, kToml, kOpenCv, kColmapCameras };

bool IsCommentLine(std::string_view line) {
  return line.empty() || line.front() == '#' || line.front() == '%' || line.starts_with("//");
}

Format TellFormat(const std::string& path, std::string_view content) {
  if (Trim(content).empty()) throw BadCalibration(path, 0, "is empty");
  if (content.find('\0') != std::string_view::npos || content.starts_with("\xFF\xD8"))
    throw BadCalibration(path, 0, "is a binary file, not a calibration");
  if (content.starts_with("\xEF\xBB\xBF")) content.remove_prefix(3);
  content = Trim(content);
  if (content.starts_with("%YAML")) return Format::kOpenCv;
  if (content.starts_with('<')) {
    if (content.find("<opencv_storage") != std::string_view::npos) return Format::kOpenCv;
    throw BadCalibration(path, 0, "is an XML file of another program");
  }
  for (const TextLine& line : SplitLines(content)) {
    if (IsCommentLine(line.text)) continue;
    const auto tokens = SplitTokens(line.text, " \t,;");
    if (line.text.starts_with("[[") && line.text.find_first_of("0123456789") == std::string_view::npos)
      return Format::kToml;
    if (line.text.find('=') != std::string_view::npos) return Format::kToml;
    if (tokens.size() >= 2 && ParseInteger(tokens[0]) && std::isalpha(static_cast<unsigned char>(tokens[1].front())) &&
        tokens[1].find_first_of("_") != std::string_view::npos)
      return Format::kColmapCameras;
    if (tokens.size() >= 4 && ParseInteger(tokens[0]) && std::isupper(static_cast<unsigned char>(tokens[1].front())) &&
        ParseInteger(tokens[2]))
      return Format::kColmapCameras;
    return Format::kMatrixText;
  }
  throw BadCalibration(path, 0, "has comments only");
}

}  // namespace

Error BadCalibration(const std::string& path, std::size_t line, const std::string& message) {
  return {ErrorCode::kInvalidInput, path, (line ? "line " + std::to_string(line) + ": " : "") + message, kFormatsHint};
}

Error UnsupportedCalibration(const std::string& path, std::size_t line, const std::string& message) {
  return {ErrorCode::kUnsupported, path, (line ? "line " + std::to_string(line) + ": " : "") + message,
          "use a pinhole model with OpenCV distortion k1..k6, p1, p2"};
}

void CheckEntry(const std::string& path, std::size_t line, const CalibrationEntry& entry) {
  CameraModel full = entry.model;
  full.kind = CameraModelKind::kFullOpenCv;
  for (const double value : CameraParams(full))
    if (!std::isfinite(value)) throw BadCalibration(path, line, "a number is not finite");
  if (!(entry.model.fx > 0) || !(entry.model.fy > 0))
    throw BadCalibration(path, line, "a focal length is not positive");
  const bool no_size = entry.width_px == 0 && entry.height_px == 0;
  if (!no_size && (entry.width_px <= 0 || entry.height_px <= 0))
    throw BadCalibration(path, line, "an image size is not positive");
}

CameraModelKind SmallestKind(const CameraModel& model) {
  if (model.k3 != 0 || model.k4 != 0 || model.k5 != 0 || model.k6 != 0) return CameraModelKind::kFullOpenCv;
  return model.HasDistortion() ? CameraModelKind::kOpenCv : CameraModelKind::kPinhole;
}

std::vector<CalibrationEntry> ReadCalibration(const std::filesystem::path& path, PixelOrigin text_origin) {
  const std::string content = ReadWholeFile(path, std::size_t{1} << 26), where = path.string();
  std::vector<CalibrationEntry> entries;
  bool center = text_origin == PixelOrigin::kCenter;
  switch (TellFormat(where, content)) {
    case Format::kMatrixText:
      entries = ParseMatrixText(where, content);
      break;
    case Format::kColmapCameras:
      entries = ParseColmapCameras(where, content);
      break;
    case Format::kOpenCv:
      entries = ParseOpenCv(where, content);
      center = true;
      break;
    case Format::kToml:
      entries = ParseToml(where, content);
      center = false;
      break;
  }
  const std::string file = path.filename().string();
  for (auto& entry : entries) {
    if (center) {
      entry.model.cx += 0.5;
      entry.model.cy += 0.5;
    }
    if (entry.label.empty()) entry.label = file;
  }
  return entries;
}

std::vector<CalibrationEntry> ParseMatrixText(const std::string& path, std::string_view content) {
  std::vector<double> k;
  std::size_t last_line = 0;
  for (const TextLine& line : SplitLines(content)) {
    if (IsCommentLine(line.text)) continue;
    const std::string_view text = line.text.substr(0, line.text.find('#'));
    for (const auto token : SplitTokens(text, " \t,;[]()")) {
      const auto value = ParseFinite(token);
      if (!value) throw BadCalibration(path, line.number, "'" + std::string(token.substr(0, 40)) + "' is not a number");
      if (k.size() == 9) throw BadCalibration(path, line.number, "more than the 9 numbers of a 3x3 K matrix");
      k.push_back(*value);
      last_line = line.number;
    }
  }
  if (k.size() != 9)
    throw BadCalibration(path, last_line, "has " + std::to_string(k.size()) + " of the 9 numbers of a 3x3 K matrix");
  if (k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1)
    throw BadCalibration(path, 0, "is no K matrix: rows must be fx 0 cx, 0 fy cy, 0 0 1");
  // A skew below a hundredth of a pixel across the image is round-off of another program's export.
  if (std::abs(k[1]) > 1e-6 * std::abs(k[0]))
    throw UnsupportedCalibration(path, 0, "K matrix with skew " + ExactText(k[1]) + " is not supported");
  CalibrationEntry entry;
  entry.model.fx = k[0];
  entry.model.fy = k[4];
  entry.model.cx = k[2];
  entry.model.cy = k[5];
  CheckEntry(path, 0, entry);
  return {entry};
}

std::vector<CalibrationEntry> ParseColmapCameras(const std::string& path, std::string_view content) {
  std::vector<CalibrationEntry> entries;
  for (const TextLine& line : SplitLines(content)) {
    if (line.text.empty() || line.text.front() == '#') continue;
    const auto tokens = SplitTokens(line.text);
    if (tokens.size() < 5) throw BadCalibration(path, line.number, "a camera is: ID MODEL WIDTH HEIGHT PARAMETERS");
    const auto kind = CameraModelKindFromName(tokens[1]);
    if (!kind)
      throw Error(
          ErrorCode::kUnsupported, path,
          "line " + std::to_string(line.number) + ": camera model " + std::string(tokens[1]) + " is not supported",
          "use SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV or FULL_OPENCV");
    const auto id = ParseInteger(tokens[0]), width = ParseInteger(tokens[2]), height = ParseInteger(tokens[3]);
    if (!id || !width || !height || *width <= 0 || *height <= 0 || *width > 1'000'000 || *height > 1'000'000)
      throw BadCalibration(path, line.number, "camera id, width and height must be positive whole numbers");
    if (tokens.size() != 4 + CameraParamCount(*kind))
      throw BadCalibration(path, line.number,
                           std::string(tokens[1]) + " has " + std::to_string(CameraParamCount(*kind)) +
                               " parameters, " + std::to_string(tokens.size() - 4) + " are given");
    std::vector<double> params;
    for (const auto token : std::span(tokens).subspan(4)) {
      const auto value = ParseFinite(token);
      if (!value) throw BadCalibration(path, line.number, "'" + std::string(token) + "' is not a number");
      params.push_back(*value);
    }
    CalibrationEntry entry;
    entry.model = CameraFromParams(*kind, params);
    entry.width_px = static_cast<int>(*width);
    entry.height_px = static_cast<int>(*height);
    entry.label = std::filesystem::path(path).filename().string() + ", camera " + std::string(tokens[0]);
    CheckEntry(path, line.number, entry);
    entries.push_back(std::move(entry));
  }
  return entries;
}

}  // namespace rilievo::io
