// Recognises its own folders by the scene's text; everything else is refused.
#include "simulation/block_folder.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "simulation/block_file.h"
#include "simulation/writer.h"

namespace rilievo::simulation {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSceneName = "scene.json";
constexpr const char* kMarkerName = "scene.json.partial";

std::optional<std::string> ReadText(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return std::nullopt;
  return std::string(std::istreambuf_iterator<char>(file), {});
}

/// The first option in which the file's scene differs, for the message; empty when that cannot be said.
std::string Difference(const std::string& text, const Scene& wanted) {
  try {
    const Scene found = ParseScene(text, "");
    for (const auto& d : SceneOptionDeclarations()) {
      const std::string is = OptionValueText(found.options, d), asked = OptionValueText(wanted.options, d);
      if (is != asked) return " (--" + std::string(d.name) + " " + is + ", not " + asked + ")";
    }
  } catch (const Error& error) {
    if (error.code() == ErrorCode::kVersion) return " (of another version of the program)";
  }
  return "";
}

void RemoveStale(const fs::path& folder) {
  std::error_code failed;
  for (const auto& entry : fs::directory_iterator(folder, failed))
    if (IsStaleTemporary(entry.path())) fs::remove(entry.path(), failed);
}

}  // namespace

BlockFolder::BlockFolder(fs::path dir, const Scene& scene) : dir_(std::move(dir)), scene_(scene) {
  std::error_code failed;
  if (fs::exists(dir_, failed) && !fs::is_directory(dir_, failed))
    throw Error(ErrorCode::kInvalidInput, dir_.string(), "is a file", "--output takes a folder");
  RefuseForeignScene();
  RefuseForeignFiles();
  Look(false);
}

void BlockFolder::RefuseForeignScene() const {
  const std::string own = SceneText(scene_);
  bool any = false;
  for (const char* name : {kSceneName, kMarkerName}) {
    const auto text = ReadText(dir_ / name);
    if (!text) continue;
    any = true;
    if (*text == own) continue;
    if (!IsSceneFile(dir_ / name))
      throw Error(ErrorCode::kInvalidInput, (dir_ / name).string(), "is there already and is no scene file",
                  "give a new or empty --output");
    throw Error(ErrorCode::kInvalidInput, dir_.string(), "holds another simulated block" + Difference(*text, scene_),
                "give a new or empty --output");
  }
  std::error_code failed;
  if (any || !fs::exists(dir_, failed)) return;
  const fs::directory_iterator inside(dir_, failed);
  if (failed)
    throw Error(ErrorCode::kIo, dir_.string(), "cannot be read: " + failed.message(), "check its permissions");
  if (std::any_of(begin(inside), end(inside), [](const auto& entry) { return !IsStaleTemporary(entry.path()); }))
    throw Error(ErrorCode::kInvalidInput, dir_.string(), "holds other files and is no simulated block",
                "give a new or empty --output");
}

void BlockFolder::RefuseForeignFiles() const {
  const std::set<std::string> own(scene_.names.begin(), scene_.names.end());
  std::error_code failed;
  std::set<std::string> foreign;  // sorted: the same one is named every time
  for (const auto& entry : fs::directory_iterator(dir_ / "images", failed))
    if (!own.contains(entry.path().filename().string()) && !IsTemporary(entry.path()))
      foreign.insert(entry.path().string());
  if (!foreign.empty())
    throw Error(ErrorCode::kInvalidInput, *foreign.begin(), "is not an image of this scene",
                "move it away, or give a new --output");
  const auto calibration = ReadText(CalibrationPath(dir_));
  if (calibration && *calibration != CalibrationToml(scene_.camera))
    throw Error(ErrorCode::kInvalidInput, CalibrationPath(dir_).string(), "is not this scene's calibration",
                "move it away, or give a new --output");
}

void BlockFolder::Look(bool depth) {
  std::error_code failed;
  const auto is_there = [&](const fs::path& path) { return fs::is_regular_file(path, failed); };
  has_scene_ = is_there(dir_ / kSceneName);
  has_marker_ = is_there(dir_ / kMarkerName);
  missing_data_ = false;
  for (const fs::path& path : SceneDataPaths(dir_)) missing_data_ |= !is_there(path);
  missing_images_.clear();
  for (std::size_t i = 0; i < scene_.names.size(); ++i)
    if (!is_there(ImagePath(dir_, scene_.names[i])) || (depth && !is_there(DepthPath(dir_, scene_.names[i]))))
      missing_images_.push_back(i);
}

void BlockFolder::Begin() {
  // First the marker: at no moment does an unfinished folder look finished, or belong to nobody.
  WriteSceneFile(scene_, dir_ / kMarkerName);
  std::error_code failed;
  fs::remove(dir_ / kSceneName, failed);
  if (failed)
    throw Error(ErrorCode::kIo, (dir_ / kSceneName).string(), "cannot be replaced", "check the folder's permissions");
  for (const char* folder : {"", "images", "truth", "truth/depth"}) RemoveStale(dir_ / folder);
}

void BlockFolder::Finish() {
  WriteSceneFile(scene_, dir_ / kSceneName);
  std::error_code ignored;  // a marker beside scene.json does no harm
  fs::remove(dir_ / kMarkerName, ignored);
}

void BlockFolder::WriteSceneOnly() {
  if (has_marker_ && !has_scene_)
    throw Error(ErrorCode::kInvalidInput, dir_.string(), "holds this scene's block unfinished",
                "run without --scene-only to finish it, or give a new --output");
  WriteSceneFile(scene_, dir_ / kSceneName);
}

}  // namespace rilievo::simulation
