// A block and a model as COLMAP's records, and back.
#include "block/io/colmap.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "base/check.h"
#include "block/io/camera_params.h"
#include "block/io/colmap_content.h"
#include "block/io/residuals.h"

namespace rilievo::io {
namespace {

Error Inconsistent(const std::string& message) {
  return {ErrorCode::kInvalidInput, "COLMAP model", message, "export the model again"};
}

}  // namespace

ColmapContent ContentOf(const Block& block, const Model& model) {
  ColmapContent content;
  for (const Camera& camera : block.cameras)
    content.cameras.push_back({camera.id.value + 1, static_cast<std::uint64_t>(camera.width_px),
                               static_cast<std::uint64_t>(camera.height_px), WithSufficientKind(camera.model)});
  std::map<ImageId, std::size_t> record_of;
  for (const auto& [id, pose] : model.cam_from_world) {
    const Image& image = block.image(id);
    record_of[id] = content.images.size();
    content.images.push_back({id.value + 1, image.camera_id.value + 1, pose, image.name, {}});
  }
  for (const Point& point : model.points) {
    ColmapContent::Point3 record;
    record.id = content.points.size() + 1;
    record.position = point.position;
    record.color = point.color;
    record.error_px = RmsResidualPx(block, model, point);
    for (const Observation& observation : point.observations) {
      const auto found = record_of.find(observation.feature.image);
      RILIEVO_CHECK(found != record_of.end());
      auto& image = content.images[found->second];
      record.track.emplace_back(image.id, static_cast<std::uint32_t>(image.points.size()));
      image.points.push_back({observation.measured_px, record.id});
    }
    content.points.push_back(std::move(record));
  }
  return content;
}

Rigid3 PoseFromNumbers(const std::array<double, 7>& v) {
  Rigid3 pose;
  pose.rotation = Eigen::Quaterniond(v[0], v[1], v[2], v[3]);
  pose.translation = {v[4], v[5], v[6]};
  const double norm = pose.rotation.norm();
  if (!(norm > 1e-6) || !std::isfinite(norm)) throw Inconsistent("a rotation is not a quaternion");
  if (std::abs(norm - 1) > 1e-12) pose.rotation.normalize();
  return pose;
}

ColmapModel ModelOf(ColmapContent content) {
  ColmapModel out;
  const auto by_id = [](const auto& a, const auto& b) { return a.id < b.id; };
  std::sort(content.cameras.begin(), content.cameras.end(), by_id);
  std::sort(content.images.begin(), content.images.end(), by_id);
  std::map<std::uint32_t, CameraId> cameras;
  for (const auto& record : content.cameras) {
    const CameraId id(static_cast<std::uint32_t>(out.block.cameras.size()));
    if (!cameras.emplace(record.id, id).second)
      throw Inconsistent("camera " + std::to_string(record.id) + " occurs twice");
    out.block.cameras.push_back({id, record.model, static_cast<int>(record.width_px),
                                 static_cast<int>(record.height_px), CalibrationSource::kGiven,
                                 "COLMAP camera " + std::to_string(record.id)});
  }
  std::map<std::uint32_t, std::size_t> images;
  for (const auto& record : content.images) {
    const ImageId id(static_cast<std::uint32_t>(out.block.images.size()));
    const auto camera = cameras.find(record.camera_id);
    if (camera == cameras.end())
      throw Inconsistent("image " + record.name + " refers to camera " + std::to_string(record.camera_id) +
                         ", which is missing");
    if (!images.emplace(record.id, id.value).second)
      throw Inconsistent("image " + std::to_string(record.id) + " occurs twice");
    Image image;
    image.id = id;
    image.camera_id = camera->second;
    image.name = record.name;
    image.width_px = out.block.camera(camera->second).width_px;
    image.height_px = out.block.camera(camera->second).height_px;
    out.block.images.push_back(std::move(image));
    out.model.cam_from_world[id] = record.cam_from_world;
  }
  for (const auto& record : content.points) {
    Point point;
    point.position = record.position;
    point.color = record.color;
    for (const auto& [image_id, index] : record.track) {
      const auto image = images.find(image_id);
      if (image == images.end())
        throw Inconsistent("point " + std::to_string(record.id) + " refers to image " + std::to_string(image_id) +
                           ", which is missing");
      const auto& points = content.images[image->second].points;
      if (index >= points.size() || points[index].point_id != record.id)
        throw Inconsistent("point " + std::to_string(record.id) + " and image " + std::to_string(image_id) +
                           " contradict each other");
      point.observations.push_back(
          {{ImageId(static_cast<std::uint32_t>(image->second)), index}, points[index].position_px, {0, 0}});
    }
    std::sort(point.observations.begin(), point.observations.end(),
              [](const auto& a, const auto& b) { return a.feature < b.feature; });
    for (Observation& observation : point.observations)
      if (const auto residual = ResidualPx(out.block, out.model, point, observation))
        observation.residual_px = *residual;
    out.model.points.push_back(std::move(point));
  }
  return out;
}

ColmapModel ReadColmap(const FileSet& files) {
  const auto has = [&](const char* suffix) {
    return std::ranges::all_of(std::array{"cameras", "images", "points3D"},
                               [&](const char* name) { return files.contains(std::string(name) + suffix); });
  };
  if (has(".txt")) return ModelOf(ParseColmapText(files));
  if (has(".bin")) return ModelOf(ParseColmapBinary(files));
  throw Error(ErrorCode::kNotFound, "", "no COLMAP model",
              "cameras, images and points3D are needed, all .txt or all .bin");
}

}  // namespace rilievo::io
