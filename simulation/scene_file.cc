// Scene files: JSON with everything that fixes the pixels (docs/formats/scene.md).
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "block/io/camera_json.h"
#include "simulation/block_file.h"
#include "simulation/ray_grid.h"
#include "simulation/scene.h"

namespace rilievo::simulation {
namespace {

using Json = nlohmann::ordered_json;
constexpr const char* kFormat = "rilievo-scene";
constexpr int kFileVersion = 2;

Json OptionsToJson(const SceneOptions& options) {
  Json json = Json::object();
  for (const auto& d : SceneOptionDeclarations())
    std::visit([&](auto member) { json[std::string(d.name)] = options.*member; }, d.member);
  return json;
}

/// Reads members with the wanted type; every failure is one Error naming the file and the place in it.
class Reader {
 public:
  explicit Reader(std::string path) : path_(std::move(path)) {}

  [[noreturn]] void Fail(const std::string& message, ErrorCode code = ErrorCode::kInvalidInput) const {
    throw Error(code, path_, message, "write the scene anew with 'rilievo simulate'");
  }
  const Json& Member(const Json& object, const std::string& key) const {
    if (!object.is_object() || !object.contains(key)) Fail("'" + key + "' is missing");
    return object.at(key);
  }
  double Number(const Json& value, const std::string& what) const {
    if (!value.is_number() || !std::isfinite(value.get<double>())) Fail("'" + what + "' is not a number");
    return value.get<double>();
  }
  double Number(const Json& object, const std::string& key, const std::string& what) const {
    return Number(Member(object, key), what + "." + key);
  }
  std::string Text(const Json& object, const std::string& key) const {
    const Json& value = Member(object, key);
    if (!value.is_string()) Fail("'" + key + "' is not a text");
    return value.get<std::string>();
  }
  std::vector<double> Numbers(const Json& object, const std::string& key, std::size_t count) const {
    const Json& value = Member(object, key);
    if (!value.is_array() || value.size() != count)
      Fail("'" + key + "' is not a list of " + std::to_string(count) + " numbers");
    std::vector<double> numbers;
    for (const Json& element : value) numbers.push_back(Number(element, key));
    return numbers;
  }

  SceneOptions Options(const Json& json) const;
  Camera ReadCamera(const Json& json, const SceneOptions& options) const;
  void ReadImages(const Json& json, Scene& scene) const;

 private:
  std::string path_;
};

SceneOptions Reader::Options(const Json& json) const {
  SceneOptions options;
  for (const auto& d : SceneOptionDeclarations()) {
    const std::string name(d.name);
    const Json& value = Member(json, name);
    std::visit(
        [&](auto member) {
          using T = std::remove_cvref_t<decltype(options.*member)>;
          bool fits = false;
          if constexpr (std::is_same_v<T, bool>) fits = value.is_boolean();
          if constexpr (std::is_same_v<T, std::string>) fits = value.is_string();
          if constexpr (std::is_same_v<T, double>) fits = value.is_number();
          if constexpr (std::is_same_v<T, int>)
            fits = value.is_number_integer() && std::abs(value.template get<double>()) <= 2147483647.0;
          if (!fits) Fail("option '" + name + "' has the wrong type");
          options.*member = value.template get<T>();
        },
        d.member);
  }
  try {
    ValidateOptions(options, SceneOptionDeclarations());
  } catch (const Error& error) {
    Fail(error.path() + ": " + error.message());
  }
  return options;
}

Camera Reader::ReadCamera(const Json& json, const SceneOptions& options) const {
  Camera camera;
  camera.id = CameraId(0);
  camera.width_px = options.width_px;
  camera.height_px = options.height_px;
  camera.label = "simulated";
  const auto kind = CameraModelKindFromName(Text(json, "model"));
  if (!kind) Fail("'" + Text(json, "model") + "' is not a camera model");
  CameraModel& m = camera.model;
  m.kind = *kind;
  const auto read = [&](const char* key) { return Number(json, key, "camera"); };
  m.fx = read("fx_px"), m.fy = read("fy_px"), m.cx = read("cx_px"), m.cy = read("cy_px");
  m.k1 = read("k1"), m.k2 = read("k2"), m.p1 = read("p1"), m.p2 = read("p2");
  m.k3 = read("k3"), m.k4 = read("k4"), m.k5 = read("k5"), m.k6 = read("k6");
  if (!(m.fx > 0 && m.fy > 0)) Fail("the focal length is not positive");
  try {
    const RayGrid rays(camera);
  } catch (const Error& error) {
    Fail(error.message());
  }
  return camera;
}

void Reader::ReadImages(const Json& json, Scene& scene) const {
  if (!json.is_array() || json.empty()) Fail("'images' is not a list of images");
  std::set<std::string> seen;
  for (const Json& image : json) {
    scene.names.push_back(Text(image, "name"));
    const std::string& name = scene.names.back();
    if (name.empty() || name.find_first_of("/\\") != std::string::npos || name[0] == '.')
      Fail("'" + name + "' is not a file name");
    if (!seen.insert(name).second) Fail("image '" + name + "' is there twice");
    const auto q = Numbers(image, "rotation_wxyz", 4), t = Numbers(image, "translation_m", 3);
    Rigid3 pose;  // as it stands: normalising again could change the last bit
    pose.rotation = Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
    pose.translation = {t[0], t[1], t[2]};
    if (std::abs(pose.rotation.norm() - 1) > 1e-9) Fail("the rotation of '" + name + "' is not a unit quaternion");
    scene.cam_from_world.push_back(pose);
    scene.exposures.push_back(Number(image, "exposure", name));
    if (!(scene.exposures.back() > 0)) Fail("the exposure of '" + name + "' is not positive");
  }
  if (scene.names.size() != static_cast<std::size_t>(scene.options.images))
    Fail("option 'images' and the list of images disagree");
}

}  // namespace

std::string SceneText(const Scene& scene) {
  Json json = Json::object();
  json["format"] = kFormat;
  json["version"] = kFileVersion;
  json["renderer_version"] = kRendererVersion;
  json["options"] = OptionsToJson(scene.options);
  json["camera"] = io::CameraModelJson(scene.camera.model);
  json["panel_m"] = {scene.panel_m[0], scene.panel_m[1], scene.panel_m[2], scene.panel_m[3]};
  json["images"] = Json::array();
  for (std::size_t i = 0; i < scene.names.size(); ++i) {
    const Rigid3& pose = scene.cam_from_world[i];
    const Eigen::Quaterniond& q = pose.rotation;
    const Eigen::Vector3d& t = pose.translation;
    json["images"].push_back({{"name", scene.names[i]},
                              {"rotation_wxyz", {q.w(), q.x(), q.y(), q.z()}},
                              {"translation_m", {t.x(), t.y(), t.z()}},
                              {"exposure", scene.exposures[i]}});
  }
  return json.dump(1) + "\n";
}

Scene ParseScene(const std::string& text, const std::string& path) {
  const Reader reader(path);
  const Json json = Json::parse(text, nullptr, false);
  if (json.is_discarded()) reader.Fail("is not valid JSON");
  if (!json.is_object() || !json.contains("format") || json["format"] != kFormat) reader.Fail("is not a scene file");
  if (reader.Member(json, "version") != kFileVersion || reader.Member(json, "renderer_version") != kRendererVersion)
    reader.Fail("was written by another version of the program", ErrorCode::kVersion);
  Scene scene;
  scene.options = reader.Options(reader.Member(json, "options"));
  scene.camera = reader.ReadCamera(reader.Member(json, "camera"), scene.options);
  const auto panel_m = reader.Numbers(json, "panel_m", 4);
  scene.panel_m = {panel_m[0], panel_m[1], panel_m[2], panel_m[3]};
  if (scene.options.surface == "relief" && !(panel_m[1] > panel_m[0] && panel_m[3] > panel_m[2]))
    reader.Fail("the panel is empty");
  reader.ReadImages(reader.Member(json, "images"), scene);
  return scene;
}

void WriteSceneFile(const Scene& scene, const std::filesystem::path& path) { WriteBlockFile(path, SceneText(scene)); }

Scene ReadSceneFile(const std::filesystem::path& path) {
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored))
    throw Error(ErrorCode::kNotFound, path.string(), "there is no such scene file");
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  if (!file || std::filesystem::is_directory(path, ignored))
    throw Error(ErrorCode::kUnreadable, path.string(), "cannot be read");
  return ParseScene(text.str(), path.string());
}

bool IsSceneFile(const std::filesystem::path& path) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return false;
  std::ifstream file(path, std::ios::binary);
  std::string head(128, '\0');
  file.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(file.gcount()));
  return head.find("\"rilievo-scene\"") != std::string::npos;
}

}  // namespace rilievo::simulation
