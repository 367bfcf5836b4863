// Makes a block: gives every image its camera, from a calibration or from EXIF.
#include "block/io/assign_cameras.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>
#include <tuple>

#include "base/error.h"
#include "block/io/exif_focal.h"

namespace rilievo::io {
namespace {

using Size = std::pair<int, int>;

std::string SizeText(int width_px, int height_px) {
  return std::to_string(width_px) + " x " + std::to_string(height_px);
}
std::string SizeText(const Image& image) { return SizeText(image.width_px, image.height_px); }

bool IsInFolder(const std::string& name, const std::string& folder) {
  return name.size() > folder.size() + 1 && name.starts_with(folder) && name[folder.size()] == '/';
}

/// Indices of the entries for this image's folder: those of the deepest folder that names one, else those without a
/// folder.
std::vector<std::size_t> EntriesOfFolder(const Image& image, const std::vector<CalibrationEntry>& entries) {
  std::size_t deepest = 0;
  for (const auto& entry : entries)
    if (!entry.folder.empty() && IsInFolder(image.name, entry.folder)) deepest = std::max(deepest, entry.folder.size());
  std::vector<std::size_t> indices;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const std::string& folder = entries[i].folder;
    if (folder.size() == deepest && (folder.empty() || IsInFolder(image.name, folder))) indices.push_back(i);
  }
  return indices;
}

Error WrongSize(const Image& image, const CalibrationEntry& entry) {
  const bool turned = image.width_px == entry.height_px && image.height_px == entry.width_px;
  return {ErrorCode::kInvalidInput, image.name,
          "image is " + SizeText(image) + " px, the calibration (" + entry.label + ") is for " +
              SizeText(entry.width_px, entry.height_px) + " px",
          turned
              ? "the image is turned: add a calibration of its own for this size, or images as the camera stored them"
              : "use the images that were calibrated, or add a calibration of this size"};
}

/// K without a size says which image it is for only by its principal point.
void CheckPlausible(const Image& image, const CalibrationEntry& entry) {
  const double off_x = std::abs(entry.model.cx - 0.5 * image.width_px),
               off_y = std::abs(entry.model.cy - 0.5 * image.height_px);
  if (off_x <= 0.2 * image.width_px && off_y <= 0.2 * image.height_px) return;
  char text[160];
  std::snprintf(text, sizeof text,
                "calibration does not fit image size: its principal point (%.1f, %.1f) is for about %.0f x %.0f px, "
                "the image is ",
                entry.model.cx, entry.model.cy, 2 * entry.model.cx, 2 * entry.model.cy);
  throw Error(ErrorCode::kInvalidInput, image.name, text + SizeText(image) + " px",
              "use the calibration of these images, in pixels of this size");
}

std::size_t OnlyOne(const Image& image, const std::vector<std::size_t>& fitting,
                    const std::vector<CalibrationEntry>& entries) {
  if (fitting.size() == 1) return fitting.front();
  throw Error(ErrorCode::kInvalidInput, image.name,
              std::to_string(fitting.size()) + " calibrations fit this image equally: " + entries[fitting[0]].label +
                  "; " + entries[fitting[1]].label,
              "keep one of them, or write a TOML with a [[camera]] and its folder = for each, e.g. left and right");
}

/// The entry for an image; none when no entry is for its folder. Throws when those that are do not fit it.
std::optional<std::size_t> EntryFor(const Image& image, const std::vector<CalibrationEntry>& entries) {
  const auto candidates = EntriesOfFolder(image, entries);
  if (candidates.empty()) return std::nullopt;
  std::vector<std::size_t> sized, any_size;
  for (const std::size_t i : candidates) {
    if (entries[i].width_px == 0)
      any_size.push_back(i);
    else if (entries[i].width_px == image.width_px && entries[i].height_px == image.height_px)
      sized.push_back(i);
  }
  if (!sized.empty()) return OnlyOne(image, sized, entries);
  if (any_size.empty()) throw WrongSize(image, entries[candidates.front()]);
  const std::size_t chosen = OnlyOne(image, any_size, entries);
  CheckPlausible(image, entries[chosen]);
  return chosen;
}

void AssignCalibrated(Block& block, const std::vector<CalibrationEntry>& entries) {
  std::map<std::size_t, CameraId> camera_of_entry;
  std::map<std::size_t, ImageId> first_image;  // by entry
  std::vector<const Image*> without;
  for (Image& image : block.images) {
    const auto entry_index = EntryFor(image, entries);
    if (!entry_index) {
      without.push_back(&image);
      continue;
    }
    const CalibrationEntry& entry = entries[*entry_index];
    const auto [known, is_new] =
        camera_of_entry.emplace(*entry_index, CameraId(static_cast<std::uint32_t>(block.cameras.size())));
    if (is_new) {
      first_image[*entry_index] = image.id;
      block.cameras.push_back(
          {known->second, entry.model, image.width_px, image.height_px, CalibrationSource::kGiven, entry.label});
    }
    image.camera_id = known->second;
    const Image& first = block.image(first_image[*entry_index]);
    if (first.width_px != image.width_px || first.height_px != image.height_px)
      throw Error(ErrorCode::kInvalidInput, image.name,
                  "one calibration without image size (" + entry.label + ") cannot fit images of " + SizeText(first) +
                      " px (" + first.name + ") and " + SizeText(image) + " px",
                  "give a calibration with image sizes, one for each size");
  }
  if (without.empty()) return;
  throw Error(ErrorCode::kInvalidInput, without.front()->name,
              "no calibration is for the folder of this image" +
                  (without.size() > 1 ? " and " + std::to_string(without.size() - 1) + " more" : std::string()),
              "add a [[camera]] without folder, or one for their folder");
}

std::string CameraName(const ExifData& exif) {
  if (exif.model.empty()) return exif.make.empty() ? "unknown camera" : exif.make;
  return exif.make.empty() || exif.model.starts_with(exif.make) ? exif.model : exif.make + " " + exif.model;
}

void AssignFromExif(Block& block, std::vector<std::string>& warnings) {
  using Key = std::tuple<int, int, std::string, std::string, std::string, std::string, double, double, double>;
  std::map<Key, CameraId> cameras;
  std::vector<std::size_t> image_count;
  std::vector<std::string> basis;
  for (Image& image : block.images) {
    const ExifData& e = image.exif;
    const Key key{image.width_px,  image.height_px,           e.make, e.model, e.serial, e.lens, e.focal_mm,
                  e.focal_35mm_mm, e.focal_plane_x_res_per_mm};
    const auto [known, is_new] = cameras.emplace(key, CameraId(static_cast<std::uint32_t>(block.cameras.size())));
    if (is_new) {
      const auto exif_focal = FocalFromExif(e, image.width_px, image.height_px);
      Camera camera{known->second,
                    {},
                    image.width_px,
                    image.height_px,
                    exif_focal ? CalibrationSource::kExif : CalibrationSource::kGuessed,
                    CameraName(e)};
      camera.model.kind = CameraModelKind::kSimpleRadial;
      camera.model.fx = camera.model.fy =
          exif_focal ? exif_focal->focal_px : 1.2 * std::max(image.width_px, image.height_px);
      camera.model.cx = 0.5 * image.width_px;
      camera.model.cy = 0.5 * image.height_px;
      block.cameras.push_back(camera);
      image_count.push_back(0);
      basis.push_back(exif_focal ? exif_focal->basis : "");
    }
    image.camera_id = known->second;
    ++image_count[known->second.value];
  }
  for (const Camera& camera : block.cameras) {
    const bool guessed = camera.source == CalibrationSource::kGuessed;
    char focal[32];
    std::snprintf(focal, sizeof focal, "%.1f px", camera.model.fx);
    const std::size_t count = image_count[camera.id.value];
    const std::string who = std::to_string(count) + (count == 1 ? " image of " : " images of ") +
                            SizeText(camera.width_px, camera.height_px) + " px, " + camera.label;
    warnings.push_back(guessed ? "NO CALIBRATION AND NO FOCAL LENGTH IN EXIF (" + who + "): focal length guessed as " +
                                     focal + "; shape and scale of the result are unreliable; give --calibration"
                               : "NO CALIBRATION (" + who + "): focal length " + focal + " from EXIF (" +
                                     basis[camera.id.value] +
                                     "), lens distortion unknown; the result is approximate; give --calibration");
  }
}

}  // namespace

BlockWithWarnings MakeBlock(std::vector<Image> images, std::vector<QuarantinedImage> quarantined,
                            std::vector<CalibrationEntry> entries) {
  BlockWithWarnings made;
  made.block.images = std::move(images);
  made.block.quarantined = std::move(quarantined);
  for (std::size_t i = 0; i < made.block.images.size(); ++i)
    made.block.images[i].id = ImageId(static_cast<std::uint32_t>(i));
  if (entries.empty())
    AssignFromExif(made.block, made.warnings);
  else
    AssignCalibrated(made.block, entries);
  return made;
}

}  // namespace rilievo::io
