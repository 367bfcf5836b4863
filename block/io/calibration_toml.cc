// This project's calibration format in TOML.
#include <array>
#include <sstream>
#include <toml.hpp>
#include <utility>

#include "block/io/calibration_formats.h"
#include "block/io/camera_params.h"

namespace rilievo::io {
namespace {

using Member = double CameraModel::*;
constexpr std::array<std::pair<const char*, Member>, 12> kNumbers{{{"fx_px", &CameraModel::fx},
                                                                   {"fy_px", &CameraModel::fy},
                                                                   {"cx_px", &CameraModel::cx},
                                                                   {"cy_px", &CameraModel::cy},
                                                                   {"k1", &CameraModel::k1},
                                                                   {"k2", &CameraModel::k2},
                                                                   {"k3", &CameraModel::k3},
                                                                   {"k4", &CameraModel::k4},
                                                                   {"k5", &CameraModel::k5},
                                                                   {"k6", &CameraModel::k6},
                                                                   {"p1", &CameraModel::p1},
                                                                   {"p2", &CameraModel::p2}}};
constexpr std::size_t kRequired = 4;  // the first of kNumbers: focal lengths and principal point

std::size_t LineOf(const toml::value& value) { return static_cast<std::size_t>(value.location().line()); }

std::string StringAt(const std::string& path, const toml::value& value, const std::string& key) {
  if (!value.is_string()) throw BadCalibration(path, LineOf(value), "'" + key + "' must be a text in quotes");
  return value.as_string().str;
}

double NumberAt(const std::string& path, const toml::value& value, const std::string& key) {
  if (value.is_floating()) return value.as_floating();
  if (value.is_integer()) return static_cast<double>(value.as_integer());
  throw BadCalibration(path, LineOf(value), "'" + key + "' must be a number");
}

int SizeAt(const std::string& path, const toml::value& value, const std::string& key) {
  if (!value.is_integer() || value.as_integer() <= 0 || value.as_integer() > 1'000'000)
    throw BadCalibration(path, LineOf(value), "'" + key + "' must be a positive whole number of pixels");
  return static_cast<int>(value.as_integer());
}

bool SetNumber(const std::string& path, const std::string& key, const toml::value& value, CameraModel& model) {
  for (const auto& [name, member] : kNumbers)
    if (key == name) {
      model.*member = NumberAt(path, value, key);
      return true;
    }
  return false;
}

CalibrationEntry ReadCamera(const std::string& path, const toml::value& camera) {
  if (!camera.is_table()) throw BadCalibration(path, LineOf(camera), "'camera' must be a table: write [[camera]]");
  CalibrationEntry entry;
  const auto& table = camera.as_table();
  for (std::size_t i = 0; i < kRequired; ++i)
    if (table.count(kNumbers[i].first) == 0)
      throw BadCalibration(path, LineOf(camera), std::string("a camera lacks '") + kNumbers[i].first + "'");
  std::optional<CameraModelKind> kind;
  for (const auto& [key, value] : table) {
    if (key == "label") {
      entry.label = StringAt(path, value, key);
    } else if (key == "folder") {
      entry.folder = StringAt(path, value, key);
      while (entry.folder.ends_with('/')) entry.folder.pop_back();
    } else if (key == "width_px") {
      entry.width_px = SizeAt(path, value, key);
    } else if (key == "height_px") {
      entry.height_px = SizeAt(path, value, key);
    } else if (key == "model") {
      const std::string name = StringAt(path, value, key);
      kind = CameraModelKindFromName(name);
      if (!kind) throw UnsupportedCalibration(path, LineOf(value), "camera model '" + name + "' is not supported");
    } else if (!SetNumber(path, key, value, entry.model)) {
      throw BadCalibration(path, LineOf(value), "unknown key '" + key + "'");
    }
  }
  if ((entry.width_px == 0) != (entry.height_px == 0))
    throw BadCalibration(path, LineOf(camera), "width_px and height_px go together");
  entry.model.kind = kind.value_or(SmallestKind(entry.model));
  CheckEntry(path, LineOf(camera), entry);
  if (WithSufficientKind(entry.model).kind != entry.model.kind)
    throw BadCalibration(
        path, LineOf(camera),
        "model " + std::string(CameraModelName(entry.model.kind)) + " does not have all of the given parameters");
  return entry;
}

}  // namespace

std::vector<CalibrationEntry> ParseToml(const std::string& path, const std::string& content) {
  toml::value root;
  try {
    std::istringstream stream(content);
    root = toml::parse(stream, path);
  } catch (const toml::syntax_error& error) {
    throw BadCalibration(path, static_cast<std::size_t>(error.location().line()), "is not valid TOML");
  } catch (const toml::exception&) {
    throw BadCalibration(path, 0, "is not valid TOML");
  } catch (const std::runtime_error&) {  // a few malformed numbers end here
    throw BadCalibration(path, 0, "is not valid TOML");
  }
  const auto& table = root.as_table();
  if (table.count("format") == 0 || !table.at("format").is_string() ||
      table.at("format").as_string().str != "rilievo-calibration")
    throw BadCalibration(path, 0, "lacks format = \"rilievo-calibration\"");
  if (table.count("version") == 0 || !table.at("version").is_integer())
    throw BadCalibration(path, 0, "lacks version = 1");
  if (table.at("version").as_integer() != 1)
    throw Error(ErrorCode::kVersion, path,
                "calibration format version " + std::to_string(table.at("version").as_integer()) + " is not known",
                "this program reads version 1");
  for (const auto& [key, value] : table)
    if (key != "format" && key != "version" && key != "camera")
      throw BadCalibration(path, LineOf(value), "unknown key '" + key + "'");
  if (table.count("camera") == 0 || !table.at("camera").is_array() || table.at("camera").as_array().empty())
    throw BadCalibration(path, 0, "has no [[camera]]");
  std::vector<CalibrationEntry> entries;
  for (const toml::value& camera : table.at("camera").as_array()) entries.push_back(ReadCamera(path, camera));
  return entries;
}

}  // namespace rilievo::io
