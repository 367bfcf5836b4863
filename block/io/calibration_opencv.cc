// OpenCV's calibration files (cv::FileStorage, YAML or XML), one camera or the two of a stereo pair.
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>

#include "block/io/calibration_formats.h"
#include "block/io/text.h"

namespace rilievo::io {
namespace {

/// The names under which programs store K and the distortion that goes with it.
struct Names {
  const char* label;
  std::array<const char*, 4> matrix;
  std::array<const char*, 6> distortion;
};
constexpr std::array<Names, 3> kCameras{{
    {"",
     {"camera_matrix", "cameraMatrix", "Camera_Matrix", "K"},
     {"distortion_coefficients", "dist_coeffs", "distCoeffs", "Distortion_Coefficients", "distortion", "D"}},
    {"camera 1", {"M1", "K1", "cameraMatrix1", "camera_matrix_1"}, {"D1", "distCoeffs1", "dist_coeffs_1", "", "", ""}},
    {"camera 2", {"M2", "K2", "cameraMatrix2", "camera_matrix_2"}, {"D2", "distCoeffs2", "dist_coeffs_2", "", "", ""}},
}};

/// Numbers of a matrix or a plain list, row by row; empty when the node does not exist.
std::vector<double> Numbers(const std::string& path, const cv::FileNode& node) {
  if (node.empty() || node.isNone()) return {};
  std::vector<double> numbers;
  if (node.isSeq()) {
    node >> numbers;
  } else if (node.isMap()) {
    cv::Mat matrix;
    node >> matrix;
    if (matrix.empty() || matrix.channels() != 1)
      throw BadCalibration(path, 0, "'" + node.name() + "' is not a matrix");
    cv::Mat wide;
    matrix.convertTo(wide, CV_64F);
    numbers.assign(wide.begin<double>(), wide.end<double>());
  } else {
    throw BadCalibration(path, 0, "'" + node.name() + "' is not a matrix");
  }
  return numbers;
}

template <std::size_t N>
cv::FileNode FirstOf(const cv::FileStorage& file, const std::array<const char*, N>& names) {
  for (const char* name : names)
    if (*name)
      if (const cv::FileNode node = file[name]; !node.empty()) return node;
  return {};
}

void RefuseOtherModels(const std::string& path, const cv::FileStorage& file) {
  for (const char* name : {"fisheye_model", "fisheye"})
    if (const cv::FileNode node = file[name]; node.isInt() && static_cast<int>(node) != 0)
      throw UnsupportedCalibration(path, 0, "fisheye model is not supported");
  for (const char* name : {"distortion_model", "camera_model", "model_type"}) {
    const cv::FileNode node = file[name];
    if (!node.isString()) continue;
    const std::string model = node.string();
    if (model != "plumb_bob" && model != "rational_polynomial" && model != "pinhole" && model != "PINHOLE" &&
        model != "radtan")
      throw UnsupportedCalibration(path, 0, "model '" + model + "' is not supported");
  }
}

int SizeAt(const std::string& path, const cv::FileStorage& file, std::initializer_list<const char*> names) {
  for (const char* name : names) {
    const cv::FileNode node = file[name];
    if (node.empty()) continue;
    const double value = node.isInt() || node.isReal() ? static_cast<double>(node) : -1;
    if (!(value >= 1 && value <= 1e6) || value != std::floor(value))
      throw BadCalibration(path, 0, std::string("'") + name + "' is not an image size");
    return static_cast<int>(value);
  }
  return 0;
}

CameraModel ModelOf(const std::string& path, const std::vector<double>& k, const std::vector<double>& d) {
  if (k.size() != 9)
    throw BadCalibration(path, 0, "the camera matrix has " + std::to_string(k.size()) + " numbers, not 9");
  if (k[1] != 0) throw UnsupportedCalibration(path, 0, "camera matrix with skew is not supported");
  if (k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1)
    throw BadCalibration(path, 0, "the camera matrix is not fx 0 cx, 0 fy cy, 0 0 1");
  if (d.size() == 12 || d.size() == 14)
    throw UnsupportedCalibration(
        path, 0, "thin prism or tilted distortion (" + std::to_string(d.size()) + " coefficients) is not supported");
  if (!d.empty() && d.size() != 4 && d.size() != 5 && d.size() != 8)
    throw BadCalibration(path, 0, std::to_string(d.size()) + " distortion coefficients; OpenCV has 4, 5 or 8");
  CameraModel model;
  model.fx = k[0], model.fy = k[4], model.cx = k[2], model.cy = k[5];
  const auto at = [&](std::size_t i) { return i < d.size() ? d[i] : 0.0; };
  model.k1 = at(0), model.k2 = at(1), model.p1 = at(2), model.p2 = at(3), model.k3 = at(4), model.k4 = at(5),
  model.k5 = at(6), model.k6 = at(7);
  model.kind = SmallestKind(model);
  return model;
}

std::vector<CalibrationEntry> ReadCameras(const std::string& path, const cv::FileStorage& file) {
  RefuseOtherModels(path, file);
  std::vector<CalibrationEntry> entries;
  const int width_px = SizeAt(path, file, {"image_width", "imageWidth", "Image_Width", "width"});
  const int height_px = SizeAt(path, file, {"image_height", "imageHeight", "Image_Height", "height"});
  for (const Names& names : kCameras) {
    const cv::FileNode matrix = FirstOf(file, names.matrix);
    if (matrix.empty()) continue;
    CalibrationEntry entry;
    entry.model = ModelOf(path, Numbers(path, matrix), Numbers(path, FirstOf(file, names.distortion)));
    entry.width_px = width_px;
    entry.height_px = height_px;
    if (*names.label) entry.label = std::filesystem::path(path).filename().string() + ", " + names.label;
    CheckEntry(path, 0, entry);
    entries.push_back(std::move(entry));
  }
  if (entries.empty())
    throw BadCalibration(path, 0, "is an OpenCV file without a camera matrix (camera_matrix, cameraMatrix, K, M1)");
  return entries;
}

}  // namespace

std::vector<CalibrationEntry> ParseOpenCv(const std::string& path, const std::string& content) {
  try {
    const cv::FileStorage file(content, cv::FileStorage::READ | cv::FileStorage::MEMORY);
    if (!file.isOpened()) throw BadCalibration(path, 0, "is not valid OpenCV YAML or XML");
    return ReadCameras(path, file);
  } catch (const cv::Exception&) {
    throw BadCalibration(path, 0, "is not valid OpenCV YAML or XML");
  }
}

}  // namespace rilievo::io
