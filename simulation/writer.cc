// The files of a simulated block.
#include "simulation/writer.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <exiv2/exiv2.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "base/option.h"
#include "base/rng.h"
#include "simulation/block_file.h"
#include "simulation/scene_source.h"

namespace rilievo::simulation {
namespace {

namespace fs = std::filesystem;

/// Shortest text that reads back to the same double.
std::string Text(double value) {
  char text[40];
  for (int digits = 6; digits <= 17; ++digits) {
    std::snprintf(text, sizeof text, "%.*g", digits, value);
    if (std::strtod(text, nullptr) == value) break;
  }
  return text;
}

std::string TomlNumber(double value) {
  const std::string text = Text(value);
  return text.find_first_of(".e") == std::string::npos ? text + ".0" : text;
}

/// COLMAP's cameras.txt; its parameters in the order of the model.
std::string CamerasText(const Camera& camera) {
  const CameraModel& m = camera.model;
  std::vector<double> values{m.fx, m.fy, m.cx, m.cy};
  if (m.kind == CameraModelKind::kOpenCv || m.kind == CameraModelKind::kFullOpenCv)
    values.insert(values.end(), {m.k1, m.k2, m.p1, m.p2});
  if (m.kind == CameraModelKind::kFullOpenCv) values.insert(values.end(), {m.k3, m.k4, m.k5, m.k6});
  if (m.kind == CameraModelKind::kSimplePinhole || m.kind == CameraModelKind::kSimpleRadial ||
      m.kind == CameraModelKind::kRadial)
    values = {m.fx, m.cx, m.cy};
  if (m.kind == CameraModelKind::kSimpleRadial) values.push_back(m.k1);
  if (m.kind == CameraModelKind::kRadial) values.insert(values.end(), {m.k1, m.k2});
  std::string text = "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n1 " + std::string(CameraModelName(m.kind)) + " " +
                     std::to_string(camera.width_px) + " " + std::to_string(camera.height_px);
  for (const double value : values) text += " " + Text(value);
  return text + "\n";
}

/// COLMAP's images.txt: cam_from_world and an empty line of points.
std::string PosesText(const Scene& scene) {
  std::string text = "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME\n# POINTS2D[] as (X Y POINT3D_ID), none here\n";
  for (std::size_t i = 0; i < scene.names.size(); ++i) {
    const Rigid3& pose = scene.cam_from_world[i];
    const auto& q = pose.rotation;
    const auto& t = pose.translation;
    text += std::to_string(i + 1);
    for (const double value : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) text += " " + Text(value);
    text += " 1 " + scene.names[i] + "\n\n";
  }
  return text;
}

std::string PointsText(const Scene& scene, const std::vector<TruePoint>& points) {
  std::string text = "# POINT_ID X_m Y_m Z_m COUNT then COUNT times: IMAGE_NAME X_px Y_px\n";
  for (std::size_t i = 0; i < points.size(); ++i) {
    const TruePoint& point = points[i];
    text += std::to_string(i + 1);
    for (int k = 0; k < 3; ++k) text += " " + Text(point.position_m[k]);
    text += " " + std::to_string(point.projections.size());
    for (const auto& p : point.projections)
      text += " " + scene.names[p.image] + " " + Text(p.pixel_px.x()) + " " + Text(p.pixel_px.y());
    text += "\n";
  }
  return text;
}

std::string SurfacePly(const Surface& surface) {
  static_assert(std::endian::native == std::endian::little);
  std::string ply = "ply\nformat binary_little_endian 1.0\ncomment world frame, metres\nelement vertex " +
                    std::to_string(surface.vertices_m.size()) +
                    "\nproperty float x\nproperty float y\nproperty float z\nelement face " +
                    std::to_string(surface.triangles.size()) +
                    "\nproperty list uchar uint vertex_indices\nend_header\n";
  ply.reserve(ply.size() + 12 * surface.vertices_m.size() + 13 * surface.triangles.size());
  for (const auto& vertex : surface.vertices_m) ply.append(reinterpret_cast<const char*>(vertex.data()), 12);
  for (const auto& triangle : surface.triangles) {
    ply.push_back(3);
    ply.append(reinterpret_cast<const char*>(triangle.data()), 12);
  }
  return ply;
}

/// Portable float map: rows from the bottom up, negative scale = little endian.
std::string DepthPfm(const DepthImage& depth) {
  std::string pfm = "Pf\n" + std::to_string(depth.width_px) + " " + std::to_string(depth.height_px) + "\n-1.0\n";
  const std::size_t row_bytes = sizeof(float) * static_cast<std::size_t>(depth.width_px);
  for (int y = depth.height_px - 1; y >= 0; --y)
    pfm.append(reinterpret_cast<const char*>(depth.depth_m.data()) + y * row_bytes, row_bytes);
  return pfm;
}

Exiv2::ExifData ToExiv2(const ExifData& exif) {
  Exiv2::ExifData data;
  const auto rational = [](double value, std::uint32_t denominator) {
    return Exiv2::URational(static_cast<std::uint32_t>(std::lround(value * denominator)), denominator);
  };
  data["Exif.Image.Make"] = exif.make;
  data["Exif.Image.Model"] = exif.model;
  data["Exif.Image.Orientation"] = static_cast<std::uint16_t>(exif.orientation);
  data["Exif.Photo.DateTimeOriginal"] = exif.date_time;
  data["Exif.Photo.FocalLength"] = rational(exif.focal_mm, 1000);
  data["Exif.Photo.FocalLengthIn35mmFilm"] = static_cast<std::uint16_t>(exif.focal_35mm_mm);
  data["Exif.Photo.FocalPlaneXResolution"] = rational(10 * exif.focal_plane_x_res_per_mm, 1000);
  data["Exif.Photo.FocalPlaneYResolution"] = rational(10 * exif.focal_plane_x_res_per_mm, 1000);
  data["Exif.Photo.FocalPlaneResolutionUnit"] = std::uint16_t{3};  // centimetres
  data["Exif.Photo.BodySerialNumber"] = exif.serial;
  data["Exif.Photo.LensModel"] = exif.lens;
  return data;
}

std::vector<std::uint8_t> Encode(const GreyImage& grey, const SceneOptions& options, int jpeg_quality,
                                 const std::string& name) {
  // OpenCV only reads the pixels.
  const cv::Mat pixels =
      grey.Is16Bit() ? cv::Mat(grey.height_px, grey.width_px, CV_16U, const_cast<std::uint16_t*>(grey.u16.data()))
                     : cv::Mat(grey.height_px, grey.width_px, CV_8U, const_cast<std::uint8_t*>(grey.u8.data()));
  std::vector<int> parameters;
  if (options.format == "jpg") parameters = {cv::IMWRITE_JPEG_QUALITY, jpeg_quality};
  if (options.format == "png") parameters = {cv::IMWRITE_PNG_COMPRESSION, 1};
  std::vector<std::uint8_t> encoded;
  bool done = false;
  try {
    done = cv::imencode("." + options.format, pixels, encoded, parameters);
  } catch (const cv::Exception&) {
  }
  if (!done)
    throw Error(ErrorCode::kUnsupported, name, "cannot be encoded as " + options.format, "use another --format");
  return encoded;
}

}  // namespace

fs::path ImagePath(const fs::path& folder, const std::string& name) { return folder / "images" / name; }
fs::path DepthPath(const fs::path& folder, const std::string& name) {
  return folder / "truth" / "depth" / (name + ".pfm");
}
fs::path CalibrationPath(const fs::path& folder) { return folder / "calibration.toml"; }

std::vector<fs::path> SceneDataPaths(const fs::path& folder) {
  const fs::path truth = folder / "truth";
  return {CalibrationPath(folder), truth / "cameras.txt", truth / "poses.txt", truth / "points.txt",
          truth / "surface.ply"};
}

std::string CalibrationToml(const Camera& camera) {
  const CameraModel& m = camera.model;
  std::string text = "format = \"rilievo-calibration\"\nversion = 1\n\n[[camera]]\n";
  text += "label = \"" + camera.label + "\"\n";
  text += "width_px = " + std::to_string(camera.width_px) + "\nheight_px = " + std::to_string(camera.height_px) + "\n";
  text += "model = \"" + std::string(CameraModelName(m.kind)) + "\"\n";
  const std::pair<const char*, double> kAlways[] = {{"fx_px", m.fx}, {"fy_px", m.fy}, {"cx_px", m.cx}, {"cy_px", m.cy}};
  for (const auto& [name, value] : kAlways) text += std::string(name) + " = " + TomlNumber(value) + "\n";
  const std::pair<const char*, double> kLens[] = {{"k1", m.k1}, {"k2", m.k2}, {"p1", m.p1}, {"p2", m.p2},
                                                  {"k3", m.k3}, {"k4", m.k4}, {"k5", m.k5}, {"k6", m.k6}};
  for (const auto& [name, value] : kLens)
    if (value != 0) text += std::string(name) + " = " + TomlNumber(value) + "\n";
  return text;
}

std::vector<TruePoint> MakeTruePoints(const Renderer& renderer, int count) {
  const Scene& scene = renderer.scene();
  std::vector<TruePoint> points;
  for (int attempt = 0; attempt < 4 * count && static_cast<int>(points.size()) < count; ++attempt) {
    const std::size_t from = static_cast<std::size_t>(attempt) % scene.names.size();
    Rng rng(SeedFor(static_cast<std::uint64_t>(scene.options.seed), 0x706f696e, attempt));
    const double x = rng.Uniform(0, scene.camera.width_px), y = rng.Uniform(0, scene.camera.height_px);
    const auto position = renderer.SurfacePoint(from, {x, y});
    if (!position) continue;
    TruePoint point{*position, {}};
    for (std::size_t i = 0; i < scene.names.size(); ++i)
      if (renderer.Visible(*position, i)) point.projections.push_back({i, *renderer.Project(i, *position)});
    if (!point.projections.empty()) points.push_back(std::move(point));
  }
  return points;
}

void WriteSceneData(const Renderer& renderer, const fs::path& folder, const WriteOptions& options) {
  const Scene& scene = renderer.scene();
  const fs::path truth = folder / "truth";
  WriteBlockFile(CalibrationPath(folder), CalibrationToml(scene.camera));
  WriteBlockFile(truth / "cameras.txt", CamerasText(scene.camera));
  WriteBlockFile(truth / "poses.txt", PosesText(scene));
  WriteBlockFile(truth / "points.txt", PointsText(scene, MakeTruePoints(renderer, options.points)));
  WriteBlockFile(truth / "surface.ply", SurfacePly(renderer.surface()));
}

void WriteSceneImage(const Renderer& renderer, std::size_t image, const fs::path& folder, const WriteOptions& options) {
  const Scene& scene = renderer.scene();
  const std::string& name = scene.names.at(image);
  const auto encoded = Encode(renderer.RenderGrey(image), scene.options, options.jpeg_quality, name);
  try {
    const auto file = Exiv2::ImageFactory::open(encoded.data(), static_cast<long>(encoded.size()));
    file->readMetadata();
    Exiv2::ExifData exif = file->exifData();  // in TIFF the layout of the pixels is among the tags
    for (const auto& datum : ToExiv2(SceneExif(scene, image))) exif[datum.key()] = datum.value();
    file->setExifData(exif);
    file->writeMetadata();
    Exiv2::BasicIo& io = file->io();
    io.open();
    const Exiv2::byte* bytes = io.mmap();
    WriteBlockFile(ImagePath(folder, name),
                   {reinterpret_cast<const char*>(bytes), static_cast<std::size_t>(io.size())});
    io.munmap();
  } catch (const Exiv2::Error& error) {
    throw Error(ErrorCode::kInternal, name, std::string("EXIF data cannot be added: ") + error.what());
  }
}

void WriteSceneDepth(const Renderer& renderer, std::size_t image, const fs::path& folder) {
  WriteBlockFile(DepthPath(folder, renderer.scene().names.at(image)), DepthPfm(renderer.RenderDepth(image)));
}

void WriteMissing(const Renderer& renderer, std::size_t image, const fs::path& folder, const WriteOptions& options) {
  const std::string& name = renderer.scene().names.at(image);
  if (!fs::exists(ImagePath(folder, name))) WriteSceneImage(renderer, image, folder, options);
  if (options.depth && !fs::exists(DepthPath(folder, name))) WriteSceneDepth(renderer, image, folder);
}

}  // namespace rilievo::simulation
